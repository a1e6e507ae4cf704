"""The learned residual: it takes what the physics leaves, says how much, and is nothing where nothing is left."""

import functools

import numpy as np
import pytest

import vibrident
from vibrident.app.workflow.estimators import check_settings
from vibrident.base.errors import InputError, ModelError
from vibrident.fit.descent.settle import Objective
from vibrident.fit.estimators import Ipnn
from vibrident.fit.estimators.residual_network import ResidualIpnn
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.paper.free_weights import FreeIpnn
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.network.residual import initial_weights, with_residual
from vibrident.physics.simulation import SENSORS, simulate

RATE, SAMPLES = 12800.0, 800
TRAINED_HZ = (60.0, 250.0, 315.0, 400.0, 630.0, 1000.0)
OTHER_HZ = (80.0, 200.0, 280.0, 450.0, 560.0, 700.0, 900.0, 100.0, 160.0)
PHYSICS = ("sensitivity", "natural_frequency", "damping_ratio")
NOISE = 1e-3


@functools.cache
def records(sensor, frequencies=TRAINED_HZ, noise=NOISE, seed=2):
    return simulate(
        sensor, frequencies_hz=frequencies, sampling_rate_hz=RATE, samples=SAMPLES, response_noise=noise, seed=seed
    )


@functools.cache
def identified(sensor, estimator, noise=NOISE, seed=2):
    return vibrident.identify(
        records(sensor, noise=noise, seed=seed), model="accelerometer", estimator=estimator, uncertainty="noise"
    )


#: A network of one structure; which structure suits the data is chosen in `make nightly`.
MEMORY = ResidualIpnn(structures=(("memory",),))


@pytest.mark.parametrize(
    ("sensor", "estimator", "learned"),
    [
        pytest.param("cubic", ResidualIpnn(), ["neurons"], marks=pytest.mark.slow),
        pytest.param("two-mode", ResidualIpnn(), ["memory"], marks=pytest.mark.slow),
        ("two-mode", MEMORY, ["memory"]),
    ],
    ids=["cubic", "two-mode", "two-mode-memory"],
)
def test_what_the_physics_leaves_is_learned(sensor, estimator, learned):
    """At least five times closer, on records never seen, and the physics as it is: within 1 % and its uncertainty."""
    truth = SENSORS[sensor].parameters
    plain, whole = identified(sensor, Ipnn()), identified(sensor, estimator)
    found = whole.settings["residual_network"]
    assert found["structure"] == learned
    others = records(sensor, OTHER_HZ, noise=0.0)
    assert vibrident.predict(plain, others).rmse > 5.0 * vibrident.predict(whole, others).rmse
    assert found["rmse_of_physics_alone"] > 5.0 * found["rmse"]
    assert whole.fit.rmse == pytest.approx(found["rmse"], rel=1e-6)
    for name in PHYSICS:
        parameter = whole.parameters[name]
        assert parameter.value == pytest.approx(truth[name], rel=0.01)
        assert abs(parameter.value - truth[name]) < 4.0 * parameter.standard_uncertainty
    assert set(whole.parameters) == set(plain.parameters)
    # What was learned moves nothing: only that the physics alone does not explain the data is said.
    assert whole.warning_codes == ("lack_of_fit",)
    assert not whole.findings
    # Without the network at least one of them is wrong (beyond 4 u), though the misfit is weighed as noise.
    scores = [abs(plain.parameters[n].value - truth[n]) / plain.parameters[n].standard_uncertainty for n in PHYSICS]
    assert max(scores) > 4.0


def test_its_share_of_the_output_is_reported():
    """The two-mode sensor's second mode has 1 % of the static response, and more where it sways."""
    found = identified("two-mode", MEMORY).settings["residual_network"]
    by_record = found["share_by_record"]
    assert by_record["60 Hz"] == pytest.approx(0.01, rel=0.1)
    assert max(by_record, key=by_record.get) == "315 Hz"
    assert 0.01 < found["share"] < 0.05
    assert found["weights"]["memory_frequency"] == pytest.approx(300.0, rel=1e-3)


@pytest.mark.parametrize(
    ("noise", "seed", "structures"),
    [
        (0.02, 3, (("memory",),)),
        *(pytest.param(*one, ResidualIpnn().structures, marks=pytest.mark.slow) for one in ((NOISE, 2), (0.0, 4))),
    ],
)
def test_a_clean_sensor_keeps_its_parameters_and_the_share_is_zero(noise, seed, structures):
    plain = identified("paper", Ipnn(), noise, seed)
    whole = identified("paper", ResidualIpnn(structures=structures), noise, seed)
    found = whole.settings["residual_network"]
    assert not found["kept"]
    assert found["share"] == 0.0
    assert {part for (part, *others) in structures if not others} <= set(found["tried"])  # pairs only where both help
    assert not any(tried["kept"] for tried in found["tried"].values())
    for name in PHYSICS:
        assert whole.parameters[name] == plain.parameters[name]
    assert whole.warning_codes == plain.warning_codes


@pytest.mark.slow
def test_of_two_long_records_parts_are_held_out():
    made = simulate(
        "two-mode", "random", frequencies_hz=(20.0, 1200.0), sampling_rate_hz=RATE, samples=6000, repeats=2,
        response_noise=3e-3, seed=2,
    )  # fmt: skip
    whole = vibrident.identify(made, model="accelerometer", estimator=ResidualIpnn(structures=(("memory",),)))
    assert whole.settings["residual_network"]["structure"] == ["memory"]
    for name in PHYSICS:
        assert whole.parameters[name].value == pytest.approx(SENSORS["two-mode"].parameters[name], rel=1e-3)


def test_too_little_to_hold_out_leaves_the_physics_alone():
    made = simulate("cubic", frequencies_hz=(200.0, 630.0), sampling_rate_hz=RATE, samples=250, response_noise=NOISE)
    found = vibrident.identify(made, model="accelerometer", estimator=ResidualIpnn()).settings["residual_network"]
    assert not found["kept"]
    assert "too little data" in found["reason"]


def test_a_network_without_weight_is_the_physics():
    """Neurons at their beginning: cost and derivatives by the physics are those of the linear sensor at its lines."""
    made, model = records("paper"), parse("accelerometer")
    whole = with_residual(model, ("neurons",))
    values = dict(SENSORS["paper"].parameters)
    start = values | initial_weights(tuple(whole.name.split("+")[1:]), 2.0, {})
    normals = []
    for way, chosen, here in ((BinProblem, model, values), (TimeProblem, whole, start)):
        problem = way.build(made.records, chosen, method("bandlimited"), "acceleration", here)
        coordinates = Coordinates.at(chosen, here, (60.0, 1000.0), 2.0)
        level = np.ones(len(made.records))
        if way is BinProblem:
            normals.append(Objective.plain(problem, coordinates, level)(coordinates.first))
        else:
            normals.append(problem.normal(coordinates.first, coordinates, level))
    assert float(normals[1].cost) == pytest.approx(float(normals[0].cost), rel=1e-6)
    np.testing.assert_allclose(normals[1].matrix[:3, :3], normals[0].matrix, rtol=1e-6)


def test_what_it_cannot_stand_beside_is_refused():
    for name in ("velocity-pickup", "accelerometer+mode2"):
        with pytest.raises(ModelError, match="beside an accelerometer"):
            vibrident.identify(records("paper"), model=name, estimator=ResidualIpnn())
    with pytest.raises(ModelError, match="tied"):
        vibrident.identify(records("paper"), estimator=ResidualIpnn(physics=FreeIpnn()))
    with pytest.raises(InputError, match="residual does not fit"):
        check_settings("ml", {"residual": True})
