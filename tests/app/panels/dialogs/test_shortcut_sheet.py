"""How the sheet of keys is laid out."""

from hypothesis import given
from hypothesis import strategies as st

from instdrive_app.panels.dialogs.shortcuts import ShortcutGroup, balance_columns


@given(st.lists(st.integers(1, 12), max_size=12), st.integers(1, 4))
def test_sections_keep_their_order_and_columns_are_as_short_as_can_be(lengths, columns):
    sections = [ShortcutGroup(str(number), (("K", "act"),) * length) for number, length in enumerate(lengths)]
    parted = balance_columns(sections, columns)
    assert [section for column in parted for section in column] == sections
    assert len(parted) <= columns
    heights = [sum(len(section.rows) + 2 for section in column) for column in parted]
    assert max(heights, default=0) <= max(2 * sum(heights) / columns, max(lengths, default=0) + 2)
