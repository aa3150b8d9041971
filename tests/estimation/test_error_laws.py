"""Laws of errors against SciPy, on generic residuals of two channels and two batches of logs."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from error_laws import TAIL, Censored, Gaussian, StudentT
from problems import LOSSES
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.stats import kstest, norm
from scipy.stats import t as student

RNG = np.random.default_rng(12)
SIGMA = np.array([0.8, 2.3])
SHAPES = ((2, 2, 31), (1, 2, 17))
SEEN = [RNG.random(shape) > 0.2 for shape in SHAPES]
RESTS = [np.where(seen, SIGMA[:, None] * RNG.standard_t(4, size=seen.shape), 0.0) for seen in SEEN]
SIDES = [
    np.where(RNG.random(shape) < 0.25, np.sign(r), 0.0)
    for shape, r in zip(SHAPES, RESTS, strict=True)
]
NUMBERS = SimpleNamespace(
    counts=np.array([sum(seen[:, c].sum() for seen in SEEN) for c in (0, 1)], float),
    floor=np.array([1e-3, 2e-3]),
    noise=np.array([0.7, 2.9]),
    batches=[
        SimpleNamespace(measured=np.where(seen, 1.0, np.nan), beyond=side.astype(np.int8))
        for seen, side in zip(SEEN, SIDES, strict=True)
    ],
)
KNOWN = [(False, False), (True, False), (True, True)]


def channel(c, parts=RESTS):
    """All measured samples of a channel."""
    return np.concatenate([part[:, c][seen[:, c]] for part, seen in zip(parts, SEEN, strict=True)])


def likeliest(law):
    """The level at which a negative log-likelihood is lowest."""
    best = minimize_scalar(
        lambda v: law(np.exp(v)), bounds=(-4.0, 3.0), method="bounded", options={"xatol": 1e-9}
    )
    return float(np.exp(best.x))


@pytest.mark.parametrize("known", KNOWN)
def test_the_normal_law(known):
    cost, sigma = Gaussian().cost(RESTS, NUMBERS, known)
    total = 0.0
    for c in (0, 1):
        rest, count = channel(c), NUMBERS.counts[c]
        level = NUMBERS.noise[c] if known[c] else np.sqrt(np.mean(rest**2) + NUMBERS.floor[c])
        assert float(sigma[c]) == pytest.approx(level, rel=1e-12)
        scaled = 0.5 * np.sum(rest**2) / level**2
        total += scaled if known[c] else count * np.log(level)
    assert float(cost) == pytest.approx(total, rel=1e-12)
    law = Gaussian()
    np.testing.assert_array_equal(law.weights(RESTS[0], SIGMA), np.ones(SHAPES[0]))
    rest, weight = law.straight(RESTS[0], SIGMA, NUMBERS.batches[0])
    assert rest is RESTS[0]
    np.testing.assert_array_equal(weight, np.ones(SHAPES[0]))
    assert [np.asarray(b).tolist() for b in law.bend(RESTS, NUMBERS, SIGMA)] == [[[[1.0]]]] * 2
    assert (law.excess, law.closed, law.forgiving, law.censors) == (1.0, True, False, False)


@pytest.mark.parametrize("known", KNOWN)
def test_students_law(known):
    cost, sigma = StudentT().cost(RESTS, NUMBERS, known)
    total = 0.0
    for c in (0, 1):
        rest = channel(c)

        def law(s, rest=rest):
            return -np.sum(student.logpdf(rest / s, TAIL)) + rest.size * np.log(s)

        level = NUMBERS.noise[c] if known[c] else likeliest(law)
        # the floor that keeps logarithms finite lifts an estimated level by a thousandth
        assert float(sigma[c]) == pytest.approx(level, rel=1e-12 if known[c] else 5e-3)
        total += law(float(sigma[c])) + rest.size * student.logpdf(0.0, TAIL)
    assert float(cost) == pytest.approx(total, rel=1e-12)
    law = StudentT()
    assert law.excess == pytest.approx((4 + 3) / (4 + 1), rel=1e-15)
    assert (law.closed, law.forgiving, law.censors) == (False, True, False)


def score(rest, level):
    """d(-log p)/d(rest) of Student's law of four degrees of freedom."""
    return 5.0 * rest / (4.0 * level**2 + rest**2)


def test_students_weights_and_bend_are_of_its_score():
    law, level = StudentT(), SIGMA[None, :, None]
    rest, weight = law.straight(RESTS[0], SIGMA, NUMBERS.batches[0])
    np.testing.assert_allclose(weight * rest / level**2, score(rest, level), rtol=1e-12)
    step = 1e-6
    for c, bend in enumerate(np.asarray(law.bend(RESTS, NUMBERS, SIGMA)[1])[0, :, 0]):
        r, s = channel(c), SIGMA[c]
        slopes = (score(r + step, s) - score(r - step, s)) / (2 * step) * s**2
        assert bend == pytest.approx(np.mean(slopes), rel=1e-6)
    # errors that are all large would bend it the other way: it keeps a tenth
    far = law.bend([20.0 * np.ones(shape) for shape in SHAPES], NUMBERS, SIGMA)
    np.testing.assert_array_equal(far[0], np.full((1, 2, 1), 0.1))


@pytest.mark.parametrize("law", LOSSES.values(), ids=LOSSES)
def test_the_numbers_of_a_law_agree_with_its_density(law):
    """Whatever a law says of itself follows from its density; a new one is held to that, too."""
    errors = np.linspace(-9.0, 9.0, 61)

    def density(u):
        return np.exp(-float(law.penalty(np.asarray(u))) - law.constant)

    def mean(of):
        return quad(lambda u: of(np.asarray(u)) * density(u), -np.inf, np.inf, limit=200)[0]

    assert float(law.penalty(np.zeros(()))) == pytest.approx(0.0, abs=1e-15)
    assert mean(lambda u: 1.0) == pytest.approx(1.0, rel=1e-8)
    slopes = np.gradient(law.penalty(errors + 1e-6 * np.array([[-1.0], [1.0]])), 2e-6, axis=0)[0]
    np.testing.assert_allclose(errors * law.weight(errors), slopes, atol=1e-7)
    for u in (-2.0, 0.3, 4.0):
        assert float(law.below(u)) == pytest.approx(quad(density, -np.inf, u)[0], abs=1e-8)
    squared = mean(lambda u: (u * law.weight(u)) ** 2)
    assert law.excess == pytest.approx(mean(law.weight) / squared, rel=1e-4)
    level = mean(lambda u: (u**2 * law.weight(u) - 1.0) ** 2)
    assert law.level_information == pytest.approx(level, rel=1e-6)
    drawn = law.draws(np.random.default_rng(4), (20_000,))
    assert kstest(np.asarray(law.below(drawn)), "uniform").pvalue > 1e-3
    np.testing.assert_allclose(law.weight(jnp.asarray(errors)), law.weight(errors), rtol=1e-12)


def test_probabilities_and_draws():
    errors = np.array([-7.3, -1.1, 0.0, 0.4, 2.9])
    np.testing.assert_allclose(Gaussian().below(errors), norm.cdf(errors), rtol=1e-12)
    np.testing.assert_allclose(StudentT().below(errors), student.cdf(errors, 4), rtol=1e-11)
    rng = np.random.default_rng
    np.testing.assert_array_equal(Gaussian().draws(rng(3), (2, 5)), rng(3).normal(size=(2, 5)))
    drawn = rng(3).standard_t(4.0, (2, 5))
    np.testing.assert_array_equal(StudentT().draws(rng(3), (2, 5)), drawn)


def tobit(rest, side, s):
    """The probability of what the sensor showed."""
    inside = -norm.logpdf(rest[side == 0] / s).sum() + np.sum(side == 0) * np.log(s)
    inside -= 0.5 * np.log(2 * np.pi) * np.sum(side == 0)
    # at a rail it showed at least the rail, or at most: modelled + error beyond it
    return inside - norm.logcdf(-(side * rest)[side != 0] / s).sum()


@pytest.mark.thorough
@pytest.mark.parametrize("known", KNOWN)
def test_samples_at_a_rail(known):
    law = Censored()
    assert (law.word, law.closed, law.censors, law.forgiving) == ("gaussian", False, True, False)
    cost, sigma = Censored().cost(RESTS, NUMBERS, known)
    total = 0.0
    for c in (0, 1):
        rest, side = channel(c), channel(c, SIDES)
        best = likeliest(lambda s, rest=rest, side=side: tobit(rest, side, s))
        level = NUMBERS.noise[c] if known[c] else best
        assert float(sigma[c]) == pytest.approx(level, rel=1e-12 if known[c] else 5e-3)
        total += tobit(rest, side, float(sigma[c]))
    assert float(cost) == pytest.approx(total, rel=1e-12)


def test_a_sample_at_a_rail_slopes_and_bends_as_its_probability():
    law, step = Censored(), 1e-4
    rests = np.linspace(-90.0, 90.0, 37)[None, None] * np.ones((1, 2, 1))
    for side in (-1, 0, 1):
        batch = SimpleNamespace(
            measured=np.ones(rests.shape), beyond=np.full(rests.shape, side, np.int8)
        )
        rest, weight = (np.asarray(x) for x in law.straight(rests, SIGMA, batch))
        for c, s in enumerate(SIGMA):

            def minus_log(r, side=side, s=s):
                return -norm.logcdf(-side * r / s) if side else 0.5 * (r / s) ** 2

            r = rests[0, c]
            slope = (minus_log(r + step) - minus_log(r - step)) / (2 * step)
            np.testing.assert_allclose(
                weight[0, c] * rest[0, c] / s**2, slope, rtol=1e-6, atol=1e-9
            )
            step2 = 1e-2
            bend = minus_log(r + step2) - 2 * minus_log(r) + minus_log(r - step2)
            np.testing.assert_allclose(weight[0, c] / s**2, bend / step2**2, rtol=2e-3, atol=3e-8)
        (only,) = law.bend([rests], SimpleNamespace(batches=[batch]), SIGMA)
        np.testing.assert_array_equal(only, weight)


def test_far_beyond_a_rail_nothing_is_lost():
    law = Censored()
    for at in (-29.0, -29.999, -30.001, -45.0, -1e3):
        batch = SimpleNamespace(measured=np.ones((1, 1, 1)), beyond=np.ones((1, 1, 1), np.int8))
        rest, weight = law.straight(np.full((1, 1, 1), -at), np.ones(1), batch)
        # phi / Phi by an integral that holds no difference of large numbers
        inverse = quad(lambda x, a=at: np.exp(a * x - 0.5 * x * x), 0, np.inf, epsabs=0)[0]
        ratio = 1.0 / inverse
        assert float((weight * rest)[0, 0, 0]) == pytest.approx(ratio, rel=1e-8)
        assert float(weight[0, 0, 0]) == pytest.approx(ratio * (ratio + at), rel=3e-5)
