"""The lessons' closed forms against independent ones, and the page on few experiments."""

from dataclasses import replace

import numpy as np
import pytest
from pages import story_page

from deatwin.scenarios import regression_lessons
from deatwin.scenarios.regression_lessons import constraint, occam, page, variance


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_minimum_on_a_constraint_is_that_of_a_grid(seed):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((2, 2))
    gram, least, size = root @ root.T + 0.1 * np.eye(2), 3 * rng.standard_normal(2), 0.8
    angle = np.linspace(-np.pi, np.pi, 200_001)
    circle = size * np.array([np.cos(angle), np.sin(angle)])
    diamond = circle / np.abs(circle).sum(axis=0) * size
    for edge, found in (
        (circle, constraint._on_circle(gram, least, size)),
        (diamond, constraint._on_diamond(gram, least, size)),
    ):
        errors = np.einsum("in,ij,jn->n", edge - least[:, None], gram, edge - least[:, None])
        own = float((found - least) @ gram @ (found - least))
        assert own <= errors.min() + 1e-12
        assert own == pytest.approx(errors.min(), rel=1e-6)  # the grid is 3e-5 rad wide


def test_expected_log_evidence_is_a_mean():
    # E ln N(y; 0, C) for y ~ N(m, s²) by many draws; the standard error is known from the draws.
    rng = np.random.default_rng(0)
    root = rng.standard_normal((5, 5))
    law, truth = root @ root.T + np.eye(5), rng.standard_normal(5)
    drawn = [occam._log_density(law, truth + occam.NOISE * rng.standard_normal(5)) for _ in range(4000)]
    assert occam._expected(law, truth) == pytest.approx(np.mean(drawn), abs=4 * np.std(drawn) / np.sqrt(4000))


def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page in a few seconds: fewer experiments, each measure with its own wider standard error."""
    monkeypatch.setattr(variance, "DRAWS", 40)
    monkeypatch.setattr(occam, "DRAWS", 60)
    monkeypatch.setattr(occam, "JUDGED", 10)


def test_the_page(setting, tmp_path, monkeypatch):
    few(monkeypatch)
    shares: list[float] = []
    result = regression_lessons.run(replace(setting, progress=lambda share, text: shares.append(share)))
    missed = [row for row in result["measures"] if not row["passed"]]
    assert len(result["measures"]) == 15 and not missed, missed
    assert shares == sorted(shares)
    story_page(tmp_path, ("constraint", "bias_and_variance", "razor"))
    assert (tmp_path / "regression-lessons.json").is_file()


def test_a_wrong_closed_form_does_not_pass(monkeypatch):
    few(monkeypatch)
    degrees = variance.by_degree(np.random.default_rng(2))
    object.__setattr__(degrees, "bias", np.zeros_like(degrees.bias))
    assert not page.bias_rows(degrees, degrees)[0].passed
