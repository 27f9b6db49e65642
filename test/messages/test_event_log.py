"""Events as text: they come back, and any other text is refused."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.messages import event_log


@given(reason=st.text(), after=st.none() | st.integers(0, 2**63))
def test_an_entry_comes_back(reason: str, after: int | None) -> None:
    entry = event_log.Entry('lost', after, reason)
    assert event_log.from_text(event_log.to_text(entry)) == entry


@pytest.mark.parametrize(
    'text', ['', '3', '{}', '{"event": "lost"}', '[' * 99_999, '{"event":1,"after_stamp_ns":"x"}']
)
def test_any_other_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='an event must be JSON with event'):
        event_log.from_text(text)
