"""Canvas of figures: an empty page, the robot seen from above, a legend beside the axes."""

from collections.abc import Sequence
from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patches import Polygon

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.report.style import GREY, robot_body, robot_nose, view_wedge

Place = Literal['upper left', 'upper center', 'lower center']
PAD_PX = 6.0  # between the legend and the axes


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size [in]."""
    figure = Figure(figsize=(width, height), layout='constrained')
    FigureCanvasAgg(figure)
    return figure


def draw_robot(axes: Axes, pose: Pose, colour: str = GREY, *, dashed: bool = False) -> None:
    """Draw the robot at ``pose``, or only its dashed outline."""
    style, face = ('--', 'none') if dashed else ('-', colour)
    look: dict[str, Any] = {'edgecolor': colour, 'ls': style, 'lw': 1.1, 'zorder': 4 - 2 * dashed}
    body = robot_body(pose)
    axes.add_patch(Polygon(body, fill=False, **look))
    axes.add_patch(Polygon(robot_nose(pose), facecolor=face, **look))
    axes.update_datalim(body)


def draw_field_of_view(axes: Axes, pose: Pose, angle: float) -> None:
    """Shade what a camera of that horizontal ``angle`` [rad] sees."""
    wedge = view_wedge(pose, angle=angle)
    axes.add_patch(Polygon(wedge, facecolor=GREY, alpha=0.15, edgecolor='none', zorder=1))
    axes.update_datalim(wedge)


def legend_outside(figure: Figure, handles: Sequence[Any], place: Place, *, ncols: int) -> Legend:
    """
    Draw a legend of ``handles`` at an edge of ``figure``, whose axes make room; return it.

    The layout is to be constrained. matplotlib itself has ``loc='outside ...'`` for this since
    3.7; Ubuntu 24.04 has 3.6.
    """
    legend: Legend = figure.legend(handles=list(handles), loc=place, ncols=ncols)
    canvas: Any = FigureCanvasAgg(figure)
    size = legend.get_window_extent(canvas.get_renderer())
    share = min((size.height + 2.0 * PAD_PX) / figure.bbox.height, 0.5)
    bottom = share if place.startswith('lower') else 0.0
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, bottom, 1.0, 1.0 - share), h_pad=2.0 * PAD_PX / figure.dpi)
    return legend
