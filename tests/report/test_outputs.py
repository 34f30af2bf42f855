"""What a study leaves in its folder."""

import numpy as np
import pytest

from drake_gait.report import build as outputs
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.settings import NetworkSettings
from drake_gait.visualization import study as study_figures


def test_a_network_with_further_outputs_is_drawn_in_the_paper_s_three(study, monkeypatch, tmp_path):
    # A study with a constraint on the cost of transport learns it as a fifth output.
    x = np.random.default_rng(0).uniform(-1, 1, (60, 16))
    targets = x[:, :5] * [0.02, 0.01, 0.1, 0.001, 0.3]
    little = NetworkSettings(epochs=5)
    network = surrogate.fit(x, targets, np.ones(60, dtype=bool), settings=little)
    drawn = []
    monkeypatch.setattr(
        study_figures, "predicted_against_simulated", lambda *arguments: drawn.append(arguments)
    )
    outputs._draw_network(study, network, tmp_path)
    ((simulated, fitted, heldout, *_),) = drawn
    assert simulated == pytest.approx(targets[:, :3] * [1e3, 1e3, np.degrees(1.0)])
    assert fitted.shape == heldout.shape == (60, 3)
