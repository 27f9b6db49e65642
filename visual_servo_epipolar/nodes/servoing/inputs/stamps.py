"""Stamps of tracks against the clock of the node: which images are no longer driven by."""

from visual_servo_epipolar.core.stamps import NOT_ADVANCING, OTHER_CLOCK_S, seconds_between

STILL_S = 0.25  # that a simulated clock stands still, and images come: a step of it is shorter
LEAP_S = 1.0  # backwards; what overtakes on a network does so by less


def refusal(stamp_ns: int, now_ns: int, max_latency: float, still_s: float = 0.0) -> str:
    """
    Return why an image of this stamp is not driven by at ``now_ns``, or ''.

    ``still_s`` [s] is for how long a simulated clock has stood at ``now_ns``.
    """
    age = seconds_between(stamp_ns, now_ns)
    if max_latency == 0.0 or abs(age) <= max_latency:
        return ''
    if stamp_ns == 0:
        return (
            'the images are stamped 0, nobody knows how old they are; let their driver stamp them'
        )
    if now_ns == 0:
        return 'use_sim_time is true, but the clock stands at 0; is /clock published?'
    if still_s > STILL_S:
        return (
            f'/clock has stood still at {seconds_between(0, now_ns):.2f} s for {still_s:.1f} s '
            'while images come; is the simulation paused, or has its publisher ended?'
        )
    if -OTHER_CLOCK_S < age < 0.0 or abs(age) >= OTHER_CLOCK_S:
        side = 'behind' if age > 0.0 else 'ahead of'
        return (
            f'the images are stamped {abs(age):.2f} s {side} the clock of the servo; set the '
            'clock of their driver, or use_sim_time where they come from a bag or a simulator'
        )
    return (
        f'the images are {age:.2f} s old when their tracks come, max_latency is {max_latency:g} '
        's; send smaller images or fewer, or synchronise the clocks'
    )


def disorder(newest_ns: int | None, stamp_ns: int) -> str:
    """Return that a stamp is not newer than the newest of the run, ``newest_ns``; or ''."""
    if newest_ns is None or stamp_ns > newest_ns:
        return ''
    back_s = seconds_between(stamp_ns, newest_ns)
    if back_s <= LEAP_S:
        return NOT_ADVANCING
    return (
        f'the stamps went back by {back_s:.1f} s: a bag played in a loop, or a clock that was '
        'set; ~/stop, then ~/start begins anew'
    )
