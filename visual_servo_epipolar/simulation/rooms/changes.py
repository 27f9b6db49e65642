"""Changes: what a room has that is another thing in the run than in the photograph."""

from collections.abc import Callable, Mapping
import math

from visual_servo_epipolar.simulation.rooms import furniture as c
from visual_servo_epipolar.simulation.rooms.building import Builder, Furniture
from visual_servo_epipolar.simulation.rooms.pictures import landscape, lettering, shapes
from visual_servo_epipolar.simulation.rooms.textures import Painting

HINGE, LEAF = -3.4, (0.9, 0.04, 2.0)  # of the door, along the front wall; its size [m]
OPENED = math.radians(75.0)


def _monitor(draw: Callable[[Painting, float], None]) -> Callable[[Builder], None]:
    """Return what puts up a monitor that shows what ``draw`` draws."""

    def build(builder: Builder) -> None:
        size, place = (0.9, 0.06, 0.55), (0.75, 4.36)
        builder.stand(Furniture('monitor', *place, size, draw, c.timber, bottom=0.36, glows=True))

    return build


def _mail(sheet: Painting, grey: float) -> None:
    sheet.fill(235.0)
    lettering(sheet, 0.04, 0.04, sheet.width - 0.08, sheet.height - 0.08, 40.0)


def _film(sheet: Painting, grey: float) -> None:
    landscape(sheet, 0.0, 0.0, sheet.width, sheet.height)
    shapes(sheet, 0.1, 0.1, 0.5 * sheet.width, 0.6 * sheet.height)


def _closed_door(builder: Builder) -> None:
    x = HINGE + 0.5 * LEAF[0]
    builder.stand(Furniture('door', x, builder.end - 0.06, LEAF, c.cupboard, c.timber))


def _open_door(builder: Builder) -> None:
    """Turn the leaf about its left edge, into the room; behind it a dark corridor is seen."""
    width, _, height = LEAF
    behind = (width, 0.01, height)
    middle = HINGE + 0.5 * width, builder.end - 0.02
    builder.stand(Furniture('corridor', *middle, behind, _corridor, _corridor))
    x = HINGE + 0.5 * width * math.cos(OPENED)
    y = builder.end - 0.06 - 0.5 * width * math.sin(OPENED)
    builder.stand(Furniture('door', x, y, LEAF, c.cupboard, c.timber, turn=-OPENED))


def _corridor(sheet: Painting, grey: float) -> None:
    sheet.fill(18.0)
    sheet.rect(0.35 * sheet.width, 0.2, 0.25 * sheet.width, 0.5, 90.0)
    sheet.roughen(3.0)


# By what changed: how it is in the photograph, and in the run.
CHANGES: Mapping[str, tuple[Callable[[Builder], None], Callable[[Builder], None]]] = {
    'monitor': (_monitor(_mail), _monitor(_film)),
    'door': (_closed_door, _open_door),
}
