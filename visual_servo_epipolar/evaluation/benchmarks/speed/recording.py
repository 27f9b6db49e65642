"""Recording benchmark: what a recorder costs the servo, and whether it misses a message."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
import shutil
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.live.chain import PlayedCamera, TRACKER_AND_SERVO
from visual_servo_epipolar.evaluation.live.processes import Cost
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

RATE = 30.0  # images a second
TURNS, TURN_S = 3, 20.0  # without and with a recorder by turns: load from elsewhere hits both
QUICK_TURNS, QUICK_TURN_S = 1, 3.0
START = Pose.from_start(0.3, -2.2, 0.0)
VIEWS, STRIDE = 30, 0.01  # images on the way to the goal, and metres between two
LATENCIES = 'image sent to twist received | p50 ms | p95 ms | p99 ms | answers'
BAGS = 'bag | images | missing | MB | processor | memory MB'
QUANTILES = ('p50', 'p95', 'p99')
NODES = {
    **TRACKER_AND_SERVO,
    'recorder_node': ('-p', 'autostart:=false', '-p', 'topics:=["*"]'),
}


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document of the benchmark."""
    turns, seconds = (QUICK_TURNS, QUICK_TURN_S) if quick else (TURNS, TURN_S)
    settings = CameraSettings(seed=seed)
    simulator = CameraSimulator(settings)
    say('taking pictures ...')
    images = views(simulator)
    with TemporaryDirectory(prefix='visual_servo_') as scratch, ExitStack() as stack:
        say('starting three nodes ...')
        loop = PlayedCamera(stack, simulator.camera, images, Path(scratch), NODES)
        loop.show_goal(simulator.photograph())
        without: list[float] = []
        stretches: list[dict[str, Any]] = []
        for number in range(turns):
            say(f'turn {number + 1} of {turns}, {2 * seconds:g} s ...')
            without += loop.show(seconds, RATE).latencies
            stretches.append(_record_turn(loop, Path(scratch), seconds))
    return {
        'size': [settings.width, settings.height],
        'rate': RATE,
        'seconds': turns * seconds,
        'without': _quantiles(without),
        'with': _quantiles([item for it in stretches for item in it.pop('latencies')]),
        'bags': stretches,
    }


def _record_turn(loop: PlayedCamera, folder: Path, seconds: float) -> dict[str, Any]:
    """Drive with the recorder on, and return its cost and the completeness of the bag."""
    bag = Path(loop.call('recorder_node/start').partition('recording to ')[2])
    loop.wait_for_listeners(2)
    recorder = loop.processes['recorder_node']
    before = Cost.of(recorder)
    drive = loop.show(seconds, RATE)
    after = Cost.of(recorder)
    loop.call('recorder_node/stop')
    recorded = stamps(folder / bag, '/image_raw')
    size = sum(path.stat().st_size for path in (folder / bag).iterdir()) / 1e6
    shutil.rmtree(folder / bag)
    return {
        'latencies': drive.latencies,
        'published': len(drive.sent),
        'missing': len(drive.sent.keys() - set(recorded)),
        'in_order': recorded == sorted(recorded),
        'mb': size,
        'processor': (after.processor_s - before.processor_s) / seconds,
        'memory_before_mb': before.memory_mb,
        'memory_after_mb': after.memory_mb,
    }


def stamps(bag: Path, topic: str) -> list[int]:
    """Return the header stamps [ns] of a topic in the order of the bag."""
    with AnyReader([bag]) as reader:
        chosen = [item for item in reader.connections if item.topic == topic]
        # A header comes first in CDR: four bytes of encapsulation, then two words of 32 bits.
        heads = [np.frombuffer(data, '<u4', 2, 4) for _, _, data in reader.messages(chosen)]
    return [int(sec) * NANOSECONDS + int(nanosec) for sec, nanosec in heads]


def _quantiles(latencies: Sequence[float]) -> dict[str, float]:
    values = 1e3 * np.quantile(latencies, (0.5, 0.95, 0.99))
    return {
        'answers': len(latencies),
        **{name: float(value) for name, value in zip(QUANTILES, values, strict=True)},
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text."""
    width, height = document['size']
    runs = {f'{name} a recorder': document[name] for name in ('without', 'with')}
    growth = [document['with'][key] / document['without'][key] - 1.0 for key in QUANTILES]
    return '\n'.join(
        [
            f'Recording, {width}x{height} mono8 at {document["rate"]:g} Hz for '
            f'{document["seconds"]:g} s beside tracker and servo',
            '',
            *aligned(
                LATENCIES,
                [
                    *(
                        [name, *(f'{it[key]:.1f}' for key in QUANTILES), str(it['answers'])]
                        for name, it in runs.items()
                    ),
                    ['growth', *(f'{each:+.0%}' for each in growth), ''],
                ],
            ),
            '',
            *aligned(BAGS, map(_bag, range(len(document['bags'])), document['bags'])),
        ]
    )


def _bag(place: int, it: Mapping[str, Any]) -> list[str]:
    return [
        *(str(place), str(it['published']), str(it['missing']), f'{it["mb"]:.0f}'),
        f'{it["processor"]:.1%}',
        f'{it["memory_before_mb"]:.0f} -> {it["memory_after_mb"]:.0f}',
    ]


def views(simulator: CameraSimulator) -> list[Image]:
    """Return images, shape (H, W), on a way ahead and back again: a cycle."""
    ahead = [
        simulator.capture(Pose(START.x, START.y + STRIDE * number, START.theta), number)
        for number in range(VIEWS)
    ]
    return ahead + ahead[-2:0:-1]
