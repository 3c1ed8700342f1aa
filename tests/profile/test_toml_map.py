"""Positions of keys in a profile: every form of TOML key and value."""

import pytest

from hdbench.errors import ProfileError
from hdbench.profile.loader import parse_profile
from hdbench.profile.toml_text import key_lines

TEXT = (
    '''# comment with [table] and key = 1
name = "a # no comment"
multi = """
not.a.key = 1
[not.a.table]
"""
"quoted key" = 'it'''
    + """'
[drive]
a.b.c = 1
list = [
  1, # one
  2,
]
inline = { x = 1, y = [3, { z = 4 }] }
date = 2026-11-21T10:00:00Z
[[model.ripple]]
order = 2.0
[model.ripple.sub]
deep = true
[[model.ripple]]
"order" = 4.0
[model.misalignment]
amplitude_nm = 1e-3
"""
)


def test_each_key_is_found_on_its_line():
    lines = key_lines(TEXT)
    expected = {
        ("name",): 2,
        ("multi",): 3,
        ("quoted key",): 7,
        ("drive",): 8,
        ("drive", "a", "b", "c"): 9,
        ("drive", "list", 0): 11,
        ("drive", "list", 1): 12,
        ("drive", "inline", "x"): 14,
        ("drive", "inline", "y", 1, "z"): 14,
        ("drive", "date"): 15,
        ("model", "ripple", 0): 16,
        ("model", "ripple", 0, "order"): 17,
        ("model", "ripple", 0, "sub", "deep"): 19,
        ("model", "ripple", 1): 20,
        ("model", "ripple", 1, "order"): 21,
        ("model", "misalignment", "amplitude_nm"): 23,
    }
    assert {key: lines.get(key) for key in expected} == expected
    assert not any("not" in map(str, key) for key in lines)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 100_000,
        "a = " + "{b=" * 100_000,
        ".".join("a" * 200_000) + " = 1",
        "[" + ".".join("a" * 200_000) + "]",
        "a = 1" + "0" * 50_000,
        'a = """' + '"' * 400_000,
        "a = '''" + "x''" * 300_000,
        "a = 1\n" * 100_000,
        "# " + "x" * 2_000_000,
        "\ufeffname = 1",
        "a\0 = 1",
        "[[a]]\n" * 150_000,
        "[[a]]\n" * 9_990,
        "a = [" + "{b = 1}, " * 28_000 + "]",
        "a = 1" + "\n" + "b.c.d.e.f.g.h.i.j = 1\n" * 9_000,
    ],
    ids=range(15),
)
def test_hostile_text_is_refused(text):
    # half a second at most; quadratic growth would take minutes
    with pytest.raises(ProfileError):
        parse_profile(text, "p.toml")
