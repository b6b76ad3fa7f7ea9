"""Formulas of found forces: this selection beside STLSQ and SR3 of pysindy on samples of the same splines.

    pip install pysindy
    PYTHONPATH=tests python tests/benchmarks/bench_formulas.py drag asymmetric quintic stop

All three have the same dictionary. pysindy's optimisers regress the values of the spline at the visited states on it,
for a row of thresholds, and the sparsest model within a tie of their best AIC counts, with the standard errors of the
spline; this selection weighs by the information of the records and refines the numbers of shapes. Measured on one case
of each of these four laws (pysindy 2.1.0): first is the true formula in four with this selection; in one, x^5, with
STLSQ and with SR3, which take 22 and 29 terms for v |v|, three bumps for x^2, and nothing of fewer than 30 terms
for the stop (STLSQ; SR3 was not run on it). A law takes a few minutes.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import hidden.hider
import numpy as np
from hidden.hider import hide
from hidden.test_discovered import LENGTH, OMEGA, SIZE, discovered

from calib.diagnosis.discovery.dictionary import dictionary
from calib.diagnosis.discovery.penalised import PenalisedFit
from calib.diagnosis.discovery.sparse import LinearisedForce, selected_formulas

THRESHOLDS = np.geomspace(1e-3, 1.0, 16)  # of a coefficient, columns and force having a root mean square of 1  [1]
TIE = 6.0  # of AIC  [1]
LAWS = {
    "drag": {"c2": SIZE / (OMEGA * LENGTH) ** 2},
    "cubic": {"k3": SIZE / LENGTH**3},
    "quintic": {"quintic": SIZE / LENGTH**5},
    "asymmetric": {"k2": SIZE / LENGTH**2},
    "stop": {"second_stop": SIZE / LENGTH**1.5, "stop_place": 0.5 * LENGTH},
    "friction": {"friction": SIZE, "friction_slip": 0.01},
}


def by_regression(fitted: PenalisedFit, make: Callable) -> str:
    """Sparsest model of pysindy within a tie of its best, in words."""
    model, states = fitted.model, fitted.model.states
    step = max(1, states.x.size // 800)
    x, v = states.x[::step], states.v[::step]
    force, error = fitted.surface(x, v)
    problem = LinearisedForce(fitted)
    arguments = tuple(own.arguments for own in model.forces)
    terms = [term for term in dictionary(arguments, states.region) if problem.is_determined(term)]
    gauge = fitted.smoothing.gauge(model.visited)
    library = np.column_stack([model.matrix(x, v) @ gauge @ problem.splines(term) for term in terms])
    library /= np.sqrt(np.mean(library**2, axis=0))
    size = np.sqrt(np.mean(force**2))
    tried = []
    for threshold in THRESHOLDS:
        chosen = np.flatnonzero(np.ravel(make(threshold).fit(library, force / size).coef_))
        if 0 < chosen.size < 30:
            left = force - library[:, chosen] @ np.linalg.lstsq(library[:, chosen], force, rcond=None)[0]
            aic = float(np.sum((left / error) ** 2)) * fitted.effective_parameters / x.size + 2.0 * chosen.size
            tried.append((chosen.size, aic, [terms[k].structure for k in chosen], [terms[k] for k in chosen]))
    if not tried:
        return "none of fewer than 30 terms"
    least = min(aic for _, aic, _, _ in tried)
    count, _, _, own = min((t for t in tried if t[1] - least <= TIE), key=lambda t: t[:2])
    return problem.fitted(own).formula.text if count <= 4 else f"{count} terms"


def main(kinds: list[str]) -> None:
    """Print the formulas of each law."""
    from pysindy.optimizers import SR3, STLSQ  # the one thing that is not installed with the tests

    optimisers = {
        "STLSQ": lambda threshold: STLSQ(threshold=threshold, alpha=1e-6),
        "SR3": lambda threshold: SR3(reg_weight_lam=threshold**2 / 2.0, regularizer="L0"),
    }
    for kind in kinds or list(LAWS):
        folder = Path(tempfile.mkdtemp())
        hidden.hider.drawn_remainder = lambda at, share, seed, kind=kind: (kind, LAWS[kind])
        hide("oscillator", None, None, 0, folder=folder, cache=folder, remainder=0.1)
        found = discovered(folder)
        fitted = found.chosen.fitted
        print(kind)
        print(f"  by information, linearised   {selected_formulas(LinearisedForce(fitted))[0].formula.text}")
        print(f"  refitted in the simulator    {found.formulas[0].formula.text}")
        for name, make in optimisers.items():
            print(f"  {name:28s} {by_regression(fitted, make)}")


if __name__ == "__main__":
    main(sys.argv[1:])
