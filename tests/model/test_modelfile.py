import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdbench.errors import DataError
from hdbench.model import BenchModel, CauseTerm, catalogue, load_model, save_model
from hdbench.profile import Profile


def term_of(name: str, seed: int) -> CauseTerm:
    """Return a cause with numbers inside of its domain."""
    rng = np.random.default_rng(seed)
    cause = catalogue()[name]
    shape = {}
    for parameter in cause.shape:
        low, high = (parameter.bands or ((parameter.lower, parameter.upper),))[0]
        shape[parameter.name] = float(rng.uniform(low, high))
    linear = tuple(float(rng.uniform(max(p.lower, -1.0), min(p.upper, 1.0))) for p in cause.linear)
    n = len(linear) + len(shape)
    root = rng.normal(size=(n, n))
    covariance = tuple(tuple(row) for row in (root @ root.T).tolist())
    return CauseTerm(name, shape, linear, covariance)


def written(path: Path, profile: Profile, *terms: CauseTerm) -> BenchModel:
    model = BenchModel.from_profile(profile.data)
    for term in terms:
        model = model.with_cause(term)
    save_model(path, model, profile=profile, provenance={"run": "runs/x"})
    return model


def test_a_model_comes_back_with_the_same_bits(tmp_path, profile, make_motion):
    path = tmp_path / "model.json"
    terms = [term_of(name, seed) for seed, name in enumerate(catalogue())]
    model = written(path, profile, *terms)
    found = load_model(path)
    assert found.causes == model.causes
    motion = make_motion()
    assert found.torque_nm(motion).tobytes() == model.torque_nm(motion).tobytes()
    assert found.provenance == {"baseline": "profile cim-tr-97-06", "run": "runs/x"}
    again = tmp_path / "again.json"
    save_model(again, found, profile=profile, provenance={})
    assert again.read_bytes() == path.read_bytes()


def test_the_file_says_what_the_contract_says(tmp_path, profile):
    path = tmp_path / "model.json"
    written(path, profile, CauseTerm("ripple-harmonic", {"order": 3.37}, (0.3, -0.4)))
    body = json.loads(path.read_text())
    assert body["schema"] == "hdbench/model/1"
    assert body["profile"] == {"name": "cim-tr-97-06", "sha256": profile.sha256}
    assert body["baseline"]["inertia_nm_s2"] == 1.725e-2 / 100
    assert body["baseline"]["load"] == 1.0
    assert body["definitions"] == []
    assert body["baseline"]["ripple"][0] == {"order": 2.0, "amplitude_nm": 0.4, "phase_rad": 0.6}
    (cause,) = body["causes"]
    assert cause["name"] == "ripple-harmonic"
    assert cause["parameters"]["order"] == {"value": 3.37, "std": None, "unit": "1"}
    # the hypotenuse of two parts, to the last place
    assert cause["parameters"]["amplitude_nm"]["value"] == pytest.approx(0.5, rel=1e-15, abs=0)
    want = math.atan2(0.4, 0.3)
    assert cause["parameters"]["phase_rad"]["value"] == pytest.approx(want, rel=1e-15, abs=0)


def test_a_file_of_old_still_loads(tmp_path, profile):
    path = tmp_path / "model.json"
    model = written(path, profile, CauseTerm("misalignment", {}, (0.3, -0.4)))

    def strip(body: dict[str, Any]) -> None:
        del body["definitions"]
        del body["baseline"]["load"]

    edited(path, lambda body: body["baseline"].update(load=-1.0))
    assert load_model(path).load == -1.0
    found = load_model(edited(path, strip))
    assert found.load == 1.0
    assert found.causes == model.causes


def edited(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    body = json.loads(path.read_text())
    change(body)
    path.write_text(json.dumps(body))
    return path


def test_a_person_may_write_amplitude_and_phase_alone(tmp_path, profile):
    path = tmp_path / "model.json"
    written(path, profile)
    cause = {
        "name": "misalignment",
        "parameters": {"amplitude_nm": {"value": 2.0}, "phase_rad": {"value": math.pi / 6}},
    }
    edited(path, lambda body: body.update(causes=[cause]))
    (term,) = load_model(path).causes
    # 2 cos(x + 30 deg) = sqrt(3) cos x - sin x
    assert term.linear == pytest.approx((math.sqrt(3.0), -1.0), rel=1e-15, abs=0)
    assert term.covariance is None


def test_the_example_on_the_page_is_a_model(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
    path = tmp_path / "model.json"
    path.write_text(page.split("```json\n")[1].split("```")[0])
    model = load_model(path)
    assert model.ripple == ((2.0, 0.4, 0.6),)
    assert [term.name for term in model.causes] == ["mains-hum"]


def of_baseline(**changes: Any) -> Callable[[dict[str, Any]], None]:
    return lambda body: body["baseline"].update(changes)


def of_cause(**changes: Any) -> Callable[[dict[str, Any]], None]:
    return lambda body: body["causes"][0].update(changes)


def parameters_of(body: dict[str, Any]) -> dict[str, Any]:
    return body["causes"][0]["parameters"]


NUMBER = "needed: a valid number"
BROKEN: list[tuple[Callable[[dict[str, Any]], object], str, str]] = [
    (lambda b: b.update(schema="hdbench/ripple/1"), "hdbench/model/1", ""),
    (lambda b: b.pop("baseline"), "found nothing; needed: this key", "baseline"),
    (lambda b: b.pop("causes"), "found nothing; needed: this key", "causes"),
    (of_baseline(zero_nm="0"), f"found '0'; {NUMBER}", "baseline.zero_nm"),
    (of_baseline(zero_nm=True), "found True", "baseline.zero_nm"),
    (of_baseline(inertia_nm_s2=-1), "greater than or equal to 0", "baseline.inertia_nm_s2"),
    (lambda b: b["baseline"]["ripple"][1].pop("order"), "found nothing", "baseline.ripple.1.order"),
    (of_baseline(ripple=[3]), "found 3; needed: an object", "ripple.0"),
    (of_cause(name="mains_hum"), "nearest is 'mains-hum'", "causes.0.name"),
    (of_cause(name=5), "found 5; needed: a valid string", "causes.0.name"),
    (lambda b: parameters_of(b).pop("frequency_hz"), "'frequency_hz' of mains-hum is missing", ""),
    (
        lambda b: parameters_of(b).update(frequency={"value": 1.0}),
        "'frequency' of mains-hum is unknown; nearest here: 'frequency_hz'",
        "causes.0.parameters",
    ),
    (lambda b: parameters_of(b)["frequency_hz"].update(value=55), "59.5 to 60.5 Hz", ""),
    (lambda b: parameters_of(b)["cosine_nm"].update(value=0.7), "one of the two", ""),
    (of_cause(covariance=[[1.0, 2.0]]), "no square matrix", "covariance"),
    (of_cause(covariance=[[None] * 3] * 3), NUMBER, "covariance"),
    (of_cause(covariance="x"), "needed: a valid array", "covariance"),
]


@pytest.mark.parametrize(("change", "what", "where"), BROKEN, ids=[what for _, what, _ in BROKEN])
def test_a_broken_model_file_is_told_by_place_and_need(change, what, where, tmp_path, profile):
    path = tmp_path / "model.json"
    written(path, profile, term_of("mains-hum", 1))
    load_model(path)
    with pytest.raises(DataError) as caught:
        load_model(edited(path, change))
    assert what in caught.value.what
    assert where in caught.value.where
    assert str(path) in caught.value.where


@pytest.mark.parametrize("text", ["", "[1]", '{"schema": "hdbench/model/1", "x": NaN}', "{"])
def test_a_file_that_is_no_json_object_is_refused(text, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(DataError):
        load_model(path)


def test_a_model_with_a_number_that_is_none_is_not_written(tmp_path, profile):
    model = BenchModel(math.nan, 1e-4, (), (0.0, 0.0))
    with pytest.raises(ValueError, match="not JSON compliant"):
        save_model(tmp_path / "m.json", model, profile=profile, provenance={})
    assert not (tmp_path / "m.json").exists()
