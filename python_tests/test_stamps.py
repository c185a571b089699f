"""Stamps keep every nanosecond on their way into names and back, before 1970 too."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from unlidar.stamps import format_stamp, format_stamp_ns, parse_seconds_ns, parse_stamp_ns

STAMPS_NS = st.integers(-(2**63), 2**63 - 1)


@given(STAMPS_NS)
@example(-500_000_000)
@example(-1)
@example(-(2**63))
def test_a_stamp_is_read_back_as_it_was_written(stamp_ns):
    for text in (format_stamp(stamp_ns), format_stamp_ns(stamp_ns)):
        assert parse_stamp_ns(text) == parse_seconds_ns(text) == stamp_ns


@given(st.text("0123456789.-+eE _x٣", max_size=30) | st.text(max_size=5) | st.just("1e999"))
@example("+-1")
def test_any_text_is_a_stamp_of_64_bits_or_refused(text):
    for parse in (parse_stamp_ns, parse_seconds_ns):
        try:
            assert -(2**63) <= parse(text) < 2**63
        except ValueError as error:
            assert "\n" not in str(error) or "\n" in text


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("99999999999", None),
        ("9223372036", 9_223_372_036 * 10**9),
        ("100000000000", 10**11 * 10**6),
        ("-100000000000000", -(10**17)),
        ("100000000000000000", 10**17),
        ("-0", 0),
    ],
)
def test_whole_numbers_have_the_unit_of_their_magnitude(text, stamp_ns):
    if stamp_ns is None:
        with pytest.raises(ValueError, match="292 years"):
            parse_stamp_ns(text)
    else:
        assert parse_stamp_ns(text) == stamp_ns
