"""Scenarios: the settings of all parts of a run, read from YAML."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from visual_servo_epipolar.core.cameras.model import field_of_view
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import hint, names_of, setting, Settings, updated
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.files import yaml_document
from visual_servo_epipolar.simulation.bases import PioneerSettings, SIMULATED_BASES
from visual_servo_epipolar.simulation.cameras import (
    CameraSettings,
    head_settings,
    SIMULATED_RIGS,
)
from visual_servo_epipolar.simulation.closed_loop import LoopSettings
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.light import LightSettings
from visual_servo_epipolar.simulation.point_world import PointSettings


@dataclass(frozen=True, kw_only=True)
class RunSettings(Settings):
    """What belongs to the run as a whole."""

    max_duration: float = setting(300.0, 'Longest run, simulated time [s]', low=1.0, high=36000.0)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Settings of every part of a simulated run; the defaults are the nominal scenario."""

    run: RunSettings = field(default_factory=RunSettings)
    base: PioneerSettings = field(default_factory=PioneerSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    points: PointSettings = field(default_factory=PointSettings)
    disturbances: DisturbanceSettings = field(default_factory=DisturbanceSettings)
    light: LightSettings = field(default_factory=LightSettings)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    servo: ServoSettings = field(default_factory=ServoSettings)

    def __post_init__(self) -> None:
        if self.servo.carrier.turn_rate > 0.0 and head_settings(self.camera) is None:
            raise ValueError(
                f'the camera must be on a head for a servo with rig {self.servo.rig}, got one '
                f'with rig {self.kind_of("camera")}, a fixed one; set rig of the camera to '
                'pan_tilt, or that of the servo to fixed'
            )

    def document(self) -> dict[str, Any]:
        """Return all settings by section, and by name which base and which camera rig they are."""
        sections = asdict(self)
        for section, (key, _) in KINDS.items():
            sections[section][key] = self.kind_of(section)
        return sections

    def kind_of(self, section: str) -> str:
        """Return the name of the base or of the camera rig, by its section; KeyError if none."""
        names = {kind: name for name, kind in KINDS[section][1].items()}
        return names[type(getattr(self, section))]

    def seeded(self, seed: int) -> 'Scenario':
        """Return the scenario with noise, jitter and random subsets drawn from ``seed``."""
        return replace(
            self, camera=replace(self.camera, seed=seed), servo=replace(self.servo, seed=seed)
        )

    def with_servo(self, changes: Mapping[str, Any]) -> 'Scenario':
        """Return the scenario with servo settings changed; raises InputError for a bad one."""
        try:
            return replace(self, servo=updated(self.servo, changes, 'servo'))
        except ValueError as error:
            raise InputError(str(error)) from None

    def loop(self, start: tuple[float, float, float], seed: int) -> LoopSettings:
        """Return the settings of one run from ``start``: x [m], y [m], heading error [deg]."""
        return LoopSettings(
            start=start,
            seed=seed,
            frame_rate=self.camera.frame_rate,
            receipt=self.camera.receipt._replace(seed=seed),
            max_duration=self.run.max_duration,
            servo=self.servo,
            base=self.base,
            head=head_settings(self.camera),
            field_of_view=field_of_view(self.camera.camera),
        )


# Sections that come in several kinds: the key that names the kind, and settings by its name.
KINDS: Mapping[str, tuple[str, Mapping[str, type[PioneerSettings] | type[CameraSettings]]]] = {
    'base': ('model', SIMULATED_BASES),
    'camera': ('rig', SIMULATED_RIGS),
}

# Nodes whose parameters are a section: lines such as `visual_servo gains` prints may be pasted.
NODES: Mapping[str, str] = {
    'servo_node': 'servo',
    'tracker_node': 'tracker',
    'camera_node': 'camera',
    'unicycle_node': 'base',
}
ROBOT = ('servo', 'tracker')  # sections of a robot's own nodes, to which a file for all belongs
ALL_NODES = '/**'
# Parameters of the connections of these nodes: a simulation has none of them.
CONNECTION = frozenset(
    (
        'ackermann arming_timeout autostart_node base_frame camera_reliability capture_adds '
        'capture_frames cropped desired_image enable_stamped_cmd_vel enable_timeout '
        'head_command max_latency max_photographs mount_from_tf pan_joint photograph projection '
        'rectified renew resume tilt_joint transport use_sim_time watchdog'
    ).split()
)


def from_document(
    document: Any, where: str, rig: Any = None, servo: Mapping[str, Any] | None = None
) -> Scenario:
    """
    Build a scenario from a parsed YAML document: sections of settings, all optional.

    ``model`` in the section ``base`` and ``rig`` in the section ``camera`` say which one it is;
    its settings are the others of that section. Sections may as well be ROS parameters of their
    nodes: ``servo_node: {ros__parameters: {...}}``, and ``/**`` for servo and tracker. What a
    ``rig`` sets, a document of the same form, wins; ``servo`` are settings where neither has any.

    Raises InputError if a section or a setting is unknown, given twice, of a wrong type, or
    out of range.
    """
    document = _by_section(document, where)
    for section, values in _by_section(rig, where).items():
        given = document.get(section) or {}
        is_merged = isinstance(given, Mapping) and isinstance(values, Mapping)
        document[section] = {**given, **values} if is_merged else values
    if servo and isinstance(document.get('servo') or {}, Mapping):
        document['servo'] = {**servo, **(document.get('servo') or {})}
    names = [item.name for item in fields(Scenario)]
    unknown = sorted(str(key) for key in document if key not in names)
    if unknown:
        raise InputError(f'{where}: no section {", ".join(unknown)}; {hint(unknown, names)}')
    try:
        sections: dict[str, Any] = {
            name: _section(name, {} if values is None else values, f'{where}: {name}')
            for name, values in document.items()
        }
        return replace(Scenario(), **sections)
    except ValueError as error:
        raise InputError(str(error)) from None


def _by_section(document: Any, where: str) -> dict[str, Any]:
    """Return ``document`` with the parameters of nodes in the sections that they belong to."""
    if document is None:
        return {}
    if not isinstance(document, Mapping):
        raise InputError(f'{where}: a scenario must map sections to settings, got {document!r}')
    sections: dict[str, Any] = {}
    of_all: dict[str, Any] = {}
    of_nodes: dict[str, dict[str, Any]] = {}
    for key, values in document.items():
        node = str(key).rpartition('/')[2]
        if str(key) == ALL_NODES:
            of_all = _parameters(ALL_NODES, values, where)
        elif node in NODES:
            of_nodes.setdefault(NODES[node], {}).update(_parameters(node, values, where))
        else:
            sections[key] = values
    for section, values in of_nodes.items():
        given = sections.get(section)
        if isinstance(given, Mapping) and (twice := sorted(values.keys() & given.keys())):
            raise InputError(
                f'{where}: {", ".join(twice)} must be given once, got it in {section} and in '
                f'{section}_node; keep one of them'
            )
    known = {section: names_of(getattr(Scenario(), section)) for section in ROBOT}
    names = [name for section in ROBOT for name in known[section]]
    if unknown := sorted(of_all.keys() - set(names)):
        raise InputError(
            f'{where}: {ALL_NODES} has no setting {", ".join(unknown)}; {hint(unknown, names)}'
        )
    # A file for all nodes whose names one of them has is that one's: both have min_features.
    whole = [section for section in ROBOT if of_all.keys() <= set(known[section])]
    for section in whole or ROBOT:
        shared = {name: value for name, value in of_all.items() if name in known[section]}
        of_nodes[section] = {**shared, **of_nodes.get(section, {})}
    for section, values in of_nodes.items():
        given = sections.get(section) or {}
        if values and isinstance(given, Mapping):
            sections[section] = {**values, **given}
    return sections


def _parameters(node: str, body: Any, where: str) -> dict[str, Any]:
    """Return the ROS parameters of a node that are settings, by name."""
    values = body.get('ros__parameters') if isinstance(body, Mapping) else None
    if not isinstance(values, Mapping):
        raise InputError(
            f'{where}: parameters of {node} must stand under ros__parameters, as "name: value"'
        )
    return {str(name): value for name, value in values.items() if name not in CONNECTION}


def _section(name: str, values: Any, where: str) -> Settings:
    """Return the settings of one section; raises ValueError for a bad one."""
    settings: Settings = getattr(Scenario(), name)
    if name in KINDS and isinstance(values, Mapping):
        key, models = KINDS[name]
        kind, values = values.get(key), {k: v for k, v in values.items() if k != key}
        if kind is not None and kind not in tuple(models):
            raise ValueError(f'{where}: {key} must be one of {", ".join(models)}, got {kind!r}')
        settings = settings if kind is None else models[kind]()
    return updated(settings, values, where)


def load(
    path: Path | None, rig: Path | None = None, servo: Mapping[str, Any] | None = None
) -> Scenario:
    """Read a scenario file, and a rig of the same form; InputError if it cannot be used."""
    documents: dict[Path | None, Any] = {}
    for each in (rig, path):
        if each is not None:
            documents[each] = _read(each)
    where = ' with '.join(str(each) for each in (path, rig) if each is not None)
    try:
        return from_document(documents.get(path), where, documents.get(rig), servo)
    except InputError:
        for each, document in documents.items():  # what one of them says alone is its own mistake
            from_document(document, str(each))
        raise


def _read(path: Path) -> Any:
    try:
        return yaml_document(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not text'
        raise InputError(f'{path}: scenario cannot be read: {reason}') from None
    except ValueError as error:
        raise InputError(f'{path}: scenario is not YAML: {error}') from None
