"""The table of the diagnosis' constants is what the code says, and every number has a reason."""

import diagnosis_constants


def test_the_page_is_what_the_code_says():
    assert diagnosis_constants.PAGE.read_text() == diagnosis_constants.page()


def test_every_constant_has_a_reason():
    bare = [(row.file, row.names) for row in diagnosis_constants.rows() if not row.reason]
    assert bare == []


def test_a_number_is_found_with_the_comment_above_it(tmp_path, monkeypatch):
    monkeypatch.setattr(diagnosis_constants, "ROOM", tmp_path)
    (tmp_path / "some.py").write_text(
        "# why\n# so\n_ONE, TWO = 1, 2.0\n_THREE = (3,)\nWORD = 'no'\n\nlower = 4\n_BARE = 5\n"
    )
    found = [(row.names, row.value, row.reason) for row in diagnosis_constants.rows()]
    assert found == [
        (("_ONE", "TWO"), "1, 2.0", "why so"),
        (("_THREE",), "(3,)", "as above"),
        (("_BARE",), "5", ""),
    ]
