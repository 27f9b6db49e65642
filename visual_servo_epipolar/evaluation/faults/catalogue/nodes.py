"""Faults of nodes: gone, hung, restarted, ended, taken through their states."""

from collections.abc import Callable, Mapping
from functools import partial

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.world import NODES

TRANSITIONS = ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')
TRANSITIONS_IN_A_RUN = 12


def _hung(name: str) -> Strike:
    def strike(scene: StruckRun) -> None:
        seconds = scene.spell(0.3, 8.0)
        scene.world.hang(name)
        if seconds < float('inf'):
            scene.later(seconds, lambda: scene.world.resume(name))

    return strike


def _restart(name: str) -> Strike:
    """Return a node that is gone for a while; the base begins at the start again."""

    def strike(scene: StruckRun) -> None:
        seconds = scene.draw(0.05, 4.0)
        scene.notes.append(f'after {seconds:.1f} s')
        scene.world.kill(name)
        scene.later(seconds, lambda: _again(scene, name))

    return strike


def _again(scene: StruckRun, name: str) -> None:
    if name == 'unicycle_node':
        scene.witness.record.interventions.moved_s.append(scene.witness.now_s)
    scene.world.restart(name)


def is_managed(name: str) -> bool:
    """Return whether a node is managed (lifecycle)."""
    return hasattr(NODES[name], 'trigger_deactivate')


def _transitions(name: str) -> Strike:
    def turn(scene: StruckRun, label: str) -> None:
        scene.notes.append(f'{label}: {scene.world.change_state(name, label)}')

    def strike(scene: StruckRun) -> None:
        for _ in range(TRANSITIONS_IN_A_RUN):
            label = TRANSITIONS[int(scene.rng.integers(len(TRANSITIONS)))]
            scene.later(scene.draw(0.0, 5.0), partial(turn, scene, label))

    return strike


KINDS: Mapping[str, tuple[str, Callable[[str], Strike]]] = {
    'killed': ('is gone without a word', lambda name: lambda scene: scene.world.kill(name)),
    'ended': ('ends as by SIGINT', lambda name: lambda scene: scene.world.end(name)),
    'hung': ('does nothing, for a while or for good', _hung),
    'restarted': ('is gone, and comes back', _restart),
}
FAULTS: Faults = {
    f'{name.removesuffix("_node")}_{kind}': always(
        f'{name} {words}', strike(name), base_alone=name == 'servo_node' and kind != 'ended'
    )
    for name in NODES
    for kind, (words, strike) in KINDS.items()
} | {
    f'{name.removesuffix("_node")}_transitions': always(
        f'{name} is taken through its states', _transitions(name)
    )
    for name in NODES
    if is_managed(name)
}
