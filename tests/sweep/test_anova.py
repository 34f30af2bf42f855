"""Analysis of variance."""

import numpy as np
import pytest
from scipy.stats import f_oneway

from drake_gait.errors import SettingsError
from drake_gait.sweep.anova import two_way


def layout(rows, columns, replicas):
    first, second, _ = np.meshgrid(*map(np.arange, (rows, columns, replicas)), indexing="ij")
    return first.ravel(), second.ravel()


def by_name(effects):
    return {effect.name: effect for effect in effects}


def test_a_balanced_table_has_the_textbook_s_sums_of_squares():
    first, second = layout(2, 2, 2)
    y = np.array([1.0, 3.0, 4.0, 6.0, 5.0, 7.0, 12.0, 14.0])
    found = by_name(two_way(y, first, second, np.zeros(8), ("a", "b")))
    # By hand: row means 3.5 and 9.5, column means 4 and 9, cells 2, 5, 6, 13, grand mean 6.5.
    assert found["a"].squares == pytest.approx(8 * 3.0**2)
    assert found["b"].squares == pytest.approx(8 * 2.5**2)
    assert found["interaction"].squares == pytest.approx(8 * 1.0**2)
    assert found["residual"].squares == pytest.approx(4 * 2 * 1.0)
    assert [found[name].degrees for name in ("a", "b", "interaction", "residual")] == [1, 1, 1, 4]
    assert found["a"].ratio == pytest.approx(72.0 / 2.0)
    assert sum(effect.share for effect in found.values()) == pytest.approx(1.0)


def test_a_second_factor_of_one_level_gives_the_one_way_analysis():
    rng = np.random.default_rng(0)
    first = np.repeat([0, 1, 2], [4, 7, 5])
    y = rng.normal(size=16) + first
    found = by_name(two_way(y, first, np.zeros(16, dtype=int), np.zeros(16), ("a", "b")))
    expected = f_oneway(*(y[first == level] for level in range(3)))
    assert found["a"].ratio == pytest.approx(expected.statistic)
    assert found["a"].p_value == pytest.approx(expected.pvalue)
    assert found["b"].degrees == 0
    assert found["b"].p_value is None


def test_a_difference_between_blocks_changes_no_effect():
    rng = np.random.default_rng(1)
    first, second = layout(3, 2, 4)
    blocks = np.tile([0, 1], 12)
    y = rng.normal(size=24) + first
    for moved in (y, y + 100.0 * blocks):
        effects = two_way(moved, first, second, blocks)
        squares = [effect.squares for effect in effects]
        if moved is y:
            before = squares
    assert squares == pytest.approx(before, rel=1e-6)


def test_a_factor_that_does_nothing_is_rarely_called_one_that_does():
    rng = np.random.default_rng(2)
    first, second = layout(3, 3, 3)
    p_values = [
        two_way(rng.normal(size=27) + 2.0 * second, first, second, np.zeros(27))[0].p_value
        for _ in range(400)
    ]
    # One in twenty, within three standard deviations of 400 draws.
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.033)


@pytest.mark.parametrize("y", [np.arange(4.0), np.repeat([1.0, 2.0, 3.0, 4.0], 2)])
def test_responses_that_cannot_be_analysed_are_refused(y):
    first, second = layout(2, 2, len(y) // 4)
    with pytest.raises(SettingsError, match=rf"4 parameters.*got {len(y)}"):
        two_way(y, first, second, np.zeros(len(y)))
