"""Markdown tables."""

from __future__ import annotations

from glsim.files.markdown import markdown_table


def test_a_table_is_its_head_a_rule_and_its_rows() -> None:
    table = (["a", "b"], [["1", "2"], ["3", ""]])
    assert markdown_table(*table) == ["| a | b |", "|---|---|", "| 1 | 2 |", "| 3 |  |"]
