from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hdbench.errors import DataError
from hdbench.model import (
    BenchModel,
    Cause,
    CauseTerm,
    Motion,
    catalogue,
    cause_named,
    describe_causes,
    load_causes,
    load_model,
    save_model,
    user_causes,
)
from hdbench.model.cause import plugin_causes
from hdbench.profile import Profile

Make = Callable[..., Motion]
EXAMPLE = (Path(__file__).parents[2] / "docs" / "causes.md").read_text(encoding="utf-8")


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def one(tmp_path: Path, text: str) -> Cause:
    (cause,) = load_causes(written(tmp_path / "own.toml", '[[cause]]\nname = "own"\n' + text))
    return cause


def test_several_files_may_not_share_a_name(tmp_path: Path) -> None:
    text = '[[cause]]\nname = "own"\nkind = "tone"\nfrequencies_hz = [3]\n'
    first, second = (written(tmp_path / f"{n}.toml", text) for n in "ab")
    assert [c.name for c in user_causes([first])] == ["own"]
    assert user_causes([]) == ()
    with pytest.raises(DataError, match=r"stands in .*a\.toml too"):
        user_causes([first, second])


def test_a_model_file_carries_declared_causes(
    tmp_path: Path, profile: Profile, make_motion: Make
) -> None:
    toml = written(tmp_path / "own.toml", EXAMPLE.split("```toml\n")[1].split("```")[0])
    causes = user_causes([toml])
    assert len(causes) >= 4
    model = BenchModel.from_profile(profile.data).with_extra(causes)
    for cause in causes:
        shape = {p.name: 0.5 * (p.lower + p.upper) for p in cause.shape}
        model = model.with_cause(CauseTerm(cause.name, shape, (0.1,) * len(cause.linear)))
    path = tmp_path / "model.json"
    save_model(path, model, profile=profile, provenance={})
    toml.unlink()
    found = load_model(path)
    motion = make_motion()
    assert found.torque_nm(motion).tobytes() == model.torque_nm(motion).tobytes()
    assert [c.definition for c in found.extra_causes] == [c.definition for c in causes]
    # the same causes from the file and from the model are one; others of that name are none
    assert load_model(path, extra=causes).causes == found.causes
    again = tmp_path / "again.json"
    save_model(again, found, profile=profile, provenance={})
    assert again.read_bytes() == path.read_bytes()
    body = json.loads(path.read_text())
    body["definitions"][0]["name"] = "other"
    path.write_text(json.dumps(body))
    with pytest.raises(DataError, match="unknown cause"):
        load_model(path)
    body["definitions"][0]["kind"] = "tonne"
    path.write_text(json.dumps(body))
    with pytest.raises(DataError) as caught:
        load_model(path)
    assert caught.value.where == f"{path}: key definitions.0"


def test_a_declaration_that_is_not_used_stays_out_of_the_file(
    tmp_path: Path, profile: Profile
) -> None:
    cause = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [3]')
    model = BenchModel.from_profile(profile.data).with_extra([cause])
    save_model(tmp_path / "m.json", model, profile=profile, provenance={})
    assert json.loads((tmp_path / "m.json").read_text())["definitions"] == []


def test_two_causes_of_one_name_never_share_a_model(tmp_path: Path, profile: Profile) -> None:
    first = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [3]')
    other = one(tmp_path, 'kind = "tone"\nfrequencies_hz = [4]')
    model = BenchModel.from_profile(profile.data).with_extra([first, first])
    assert model.extra_causes == (first,)
    with pytest.raises(DataError, match="two causes have the name 'own'"):
        model.with_extra([other])


class _Distribution:
    name = "bench-extras"


class _Entry:
    """An entry point that gives what it is told to."""

    def __init__(self, thing: object, name: str = "extras") -> None:
        self.thing, self.name, self.value, self.dist = thing, name, "extras:causes", _Distribution()

    def load(self) -> object:
        if isinstance(self.thing, Exception):
            raise self.thing
        return self.thing


def renamed(name: str) -> Cause:
    base = catalogue()["viscous-friction"]
    return Cause(**{**{f: getattr(base, f) for f in base.__slots__}, "name": name})


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    def install(*things: object) -> None:
        plugin_causes.cache_clear()
        entries = [_Entry(thing, f"e{k}") for k, thing in enumerate(things)]
        monkeypatch.setattr("hdbench.model.cause.entry_points", lambda group: entries)

    yield install
    plugin_causes.cache_clear()


def test_an_installed_package_brings_causes(installed: Callable[..., None]) -> None:
    a, b, c, d = (renamed(f"own-{k}") for k in "abcd")
    installed(a, [b], lambda: (c, d))
    assert list(catalogue())[48:] == ["own-a", "own-b", "own-c", "own-d"]
    assert cause_named("own-c", where="here") is c
    described = describe_causes()
    assert [entry["group"] for entry in described[47:]] == ["acquisition", *["user's own"] * 4]


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        (ImportError("no module named x"), "ImportError: no module named x"),
        (lambda: 1 / 0, "ZeroDivisionError"),
        (7, "gives int; needed: hdbench.model.Cause"),
        ([renamed("own"), "x"], "gives str"),
        ([renamed("own"), renamed("own")], "'own', a name that is taken"),
        (renamed("backlash"), "'backlash', a name that is taken"),
    ],
)
def test_a_broken_package_is_named(
    thing: object, words: str, installed: Callable[..., None]
) -> None:
    installed(thing)
    with pytest.raises(DataError) as caught:
        catalogue()
    assert words in caught.value.what
    assert "'bench-extras'" in caught.value.what
    assert caught.value.where == "entry point e0 = extras:causes of group hdbench.causes"
    # models that do not need it go on
    assert cause_named("backlash", where="here").name == "backlash"


def test_the_list_of_causes_is_plain_data_in_the_contracts_order() -> None:
    described = json.loads(json.dumps(describe_causes(), allow_nan=False))
    assert [entry["name"] for entry in described] == list(catalogue())
    for entry, cause in zip(described, catalogue().values(), strict=True):
        kinds = [p["kind"] for p in entry["parameters"]]
        assert kinds == ["shape"] * len(cause.shape) + ["linear"] * len(cause.linear)
        assert all(p["unit"] and p["lower"] < p["upper"] for p in entry["parameters"])
        assert entry["additive"] is cause.additive
        assert entry["group"] != "user's own"
