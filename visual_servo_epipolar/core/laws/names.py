"""Names of laws, to list them without loading any: ``registry.LAWS`` has the laws."""

from visual_servo_epipolar.core.registry import Registry

LAW_GROUP = 'visual_servo_epipolar.laws'
OWN_LAWS = ('paper', 'corrected', 'full', 'smooth')


def law_names() -> list[str]:
    """Return the names of all laws, our own first."""
    return list(Registry(LAW_GROUP, dict.fromkeys(OWN_LAWS)))
