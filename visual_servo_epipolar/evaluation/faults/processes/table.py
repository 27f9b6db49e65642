"""The table of faults of real processes."""

from collections.abc import Mapping
from dataclasses import dataclass
import signal
from types import MappingProxyType

SUSPENDING = (signal.SIGSTOP, signal.SIGTSTP)
NODES = ('servo_node', 'tracker_node', 'camera_node', 'unicycle_node')


@dataclass(frozen=True, slots=True)
class ProcessFault:
    """
    What is done to the process of ``node``: a signal.

    ``resumes``: it may be continued later.
    """

    what: str
    node: str
    signal: signal.Signals
    resumes: bool = False

    @property
    def mute(self) -> bool:
        """Whether the servo cannot stop the base any more."""
        return self.node == 'servo_node' and self.signal in (signal.SIGKILL, signal.SIGSTOP)


KINDS: Mapping[str, tuple[signal.Signals, str]] = MappingProxyType(
    {
        'kill': (signal.SIGKILL, 'kill -9'),
        'hangup': (signal.SIGHUP, 'SIGHUP, as of a terminal that is closed'),
        'quit': (signal.SIGQUIT, 'SIGQUIT'),
        'interrupt': (signal.SIGINT, 'SIGINT'),
        'terminate': (signal.SIGTERM, 'SIGTERM'),
        'stop': (signal.SIGSTOP, 'SIGSTOP, and SIGCONT later or never'),
        'suspend': (signal.SIGTSTP, 'SIGTSTP, as of Ctrl-Z, and SIGCONT later or never'),
    }
)
PROCESSES: Mapping[str, ProcessFault] = MappingProxyType(
    {
        f'process_{kind}_{node.removesuffix("_node")}': ProcessFault(
            f'{words}, process of {node}', node, number, number in SUSPENDING
        )
        for kind, (number, words) in KINDS.items()
        for node in NODES
    }
)
