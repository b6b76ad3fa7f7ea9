"""Other methods that find a force from data, beside `calib discover`, on the same records with impacts.

    PYTHONPATH=tests python tests/benchmarks/bench_discovery.py --peers

prints the root mean square error of the force, relative to its own root mean square, over the states that the records
visit. The oscillator meets a rigid stop; two tones with an impact a period, a multisine and a free decay, displacement
and velocity with 1 % noise, the hidden law at 0.01 and 0.03 Omega^2 L. `calib discover` calibrates damping, stiffness,
amplitude and restitution at the same time, and is told neither impacts nor noise. The peers are told much more: the
true mass, damping, stiffness and amplitude, the level of the noise, and the instants of the impacts, which they need.
None of them can use what an impact does: they are given what lies between two impacts.

pysindy     weak form of the velocity's equation on domains between impacts, ensembles (bagging) of STLSQ, or
            forward regression; half width of the domains, threshold, and number of terms by leaving out one record
            after the other. "through impacts": domains anywhere.
            pysindy is no dependency: `pip install pysindy` (2.1), else it is left out
smoothed    the same regressions on derivatives after Savitzky and Golay, between impacts; their window by the same
            rule. It is what PySR would be given; PySR itself needs Julia, and was not run
latent      Kalman filter and Rauch-Tung-Striebel smoother of the linear model with a latent force of Matern-3/2
            covariance (Rogers & Friis, Mechanical Systems and Signal Processing 180 (2022) 109362), its two
            hyperparameters of greatest likelihood, the velocity unknown anew after each impact; the latent force is
            then averaged in bins over x, v or both, whichever predicts left-out records best
Regressions have a library that holds the law (powers of x and v up to the fifth degree, x |x|, v |v|, sgn v; and the
magnet, with its place and width, where that is hidden), or one that does not (without the power that is hidden; with
three harmonics of x and v beside, where predictions prefer it).
"""

import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from benchmarks.latent_force import by_latent_force
from benchmarks.peer_data import Columns, Data, Force, Piece, data_of
from hidden.foreign_laws import KINDS, Hidden, Written, hidden, system, written
from scipy.signal import savgol_filter

HIDDEN, NOISE = ("drag", "cubic", "magnet"), 0.01
SIZES = (0.01, 0.03)  # of the law, over Omega^2 L  [1]
THRESHOLDS = np.geomspace(0.03, 0.8, 8)  # of STLSQ, on columns and a target of unit norm  [1]
COUNTS = (1, 2, 3, 4, 6)  # terms of a forward regression
HALVES = (0.01, 0.02)  # s, of the domains' widths; at most half of what lies between impacts
WINDOWS = (5, 9, 17, 33)  # of Savitzky and Golay  [samples]
DOMAINS = 400  # of each record  [count]
JUDGED = 0.02  # s, half of the width of those by which a prediction is judged
POWER = 4  # of the test functions (1 - s^2)^p
MODELS = 10  # of an ensemble  [count]
STLSQ_STEPS = 20  # [count]


# --- regressions -----------------------------------------------------------------------------------------------------


def powers(x: np.ndarray, v: np.ndarray, without: str = "") -> np.ndarray:
    """Columns (n, k) of the usual terms at dimensionless x and v."""
    terms = {f"x{i}v{j}": x**i * v**j for i in range(6) for j in range(6 - i)}
    terms |= {"x|x|": x * np.abs(x), "drag": v * np.abs(v), "sgn": np.tanh(v / 0.02)}
    terms["cubic"] = terms.pop("x3v0")
    return np.column_stack([term for name, term in terms.items() if name != without])


def waves(x: np.ndarray, v: np.ndarray, without: str = "") -> np.ndarray:
    """The same with three harmonics of x and of v."""
    turns = [wave(k * np.pi * u) for k in (0.5, 1.0, 1.5) for u in (x, v) for wave in (np.sin, np.cos)]
    return np.column_stack([powers(x, v, without), *turns])


def with_magnet(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Powers, and the magnet where it stands."""
    shape = np.array([KINDS["magnet"].shape(own, 0.0) for own in x.tolist()])
    return np.column_stack([powers(x, v), shape])


def libraries(kind: str, told: bool) -> dict[str, Columns]:
    """Libraries that hold the law that is hidden, or those that do not, of which predictions choose one."""
    if told:
        return {"powers": with_magnet if kind == "magnet" else powers}
    return {name: partial(columns, without=kind) for name, columns in (("powers", powers), ("waves", waves))}


class Rows(NamedTuple):
    """Rows of a regression of one record: columns (n, k) and what they should make (n,)."""

    columns: np.ndarray
    target: np.ndarray


def weak_rows(pieces: Sequence[Piece], data: Data, columns: Columns, half: float, rng: np.random.Generator) -> Rows:
    """Weak form of v' = load - k x - c v + f on random domains: test functions (1 - s^2)^p, trapezoidal sums."""
    rows, target = [], []
    long = [piece for piece in pieces if piece.t[-1] - piece.t[0] > 2.0 * half]
    if not long:
        return Rows(np.zeros((0, columns(np.zeros(1), np.zeros(1)).shape[1])), np.zeros(0))
    spans = np.array([piece.t[-1] - piece.t[0] - 2.0 * half for piece in long])
    for k in rng.choice(len(long), DOMAINS, p=spans / spans.sum()):
        piece = long[k]
        middle = piece.t[0] + half + spans[k] * rng.uniform()
        own = np.abs(piece.t - middle) < half
        t, x, v, push = (column[own] for column in piece)
        s = (t - middle) / half
        test, slope = (1.0 - s * s) ** POWER, -2.0 * POWER * s * (1.0 - s * s) ** (POWER - 1) / half
        step = t[1] - t[0]
        target.append(step * (-slope @ v - test @ (push - data.linear[0] * x - data.linear[1] * v)))
        rows.append(step * test @ columns(x / data.sizes[0], v / data.sizes[1]))
    return Rows(np.array(rows), np.array(target))


def weak_rows_of_pysindy(
    pieces: Sequence[Piece], data: Data, columns: Columns, half: float, rng: np.random.Generator
) -> Rows:
    """The same from pysindy's weak library."""
    import pysindy as ps

    np.random.seed(int(rng.integers(2**31)))  # noqa: NPY002 - pysindy draws its domains from the global generator
    count = columns(np.zeros(1), np.zeros(1)).shape[1]
    long = [piece for piece in pieces if piece.t[-1] - piece.t[0] > 2.2 * half]
    parts = [Rows(np.zeros((0, count)), np.zeros(0))]
    total = sum(piece.t[-1] - piece.t[0] for piece in long)

    def term(k: int):
        return lambda x, v, rest: columns(*(np.asarray(u).ravel() for u in (x, v)))[:, k].reshape(np.shape(x))

    def rest_of(x, v, rest):
        return rest

    functions = [rest_of, *map(term, range(count))]
    for piece in long:
        domains = max(2, round(DOMAINS * (piece.t[-1] - piece.t[0]) / total))
        library = ps.WeakPDELibrary(
            ps.CustomLibrary(functions), spatiotemporal_grid=piece.t, H_xt=half, p=POWER, K=domains
        )
        rest = piece.load - data.linear[0] * piece.x - data.linear[1] * piece.v
        states = np.column_stack([piece.x / data.sizes[0], piece.v / data.sizes[1], rest])
        states = ps.AxesArray(states, {"ax_time": 0, "ax_coord": 1})
        rate = data.sizes[1] * np.asarray(library.convert_u_dot_integral(states))[:, 1]
        own = np.asarray(library.fit_transform([states])[0])
        parts.append(Rows(own[:, 1:], rate - own[:, 0]))
    return Rows(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def smoothed_rows(pieces: Sequence[Piece], data: Data, columns: Columns, window: int) -> Rows:
    """Accelerations from smoothed velocities at smoothed states."""
    rows, target = [columns(np.zeros(0), np.zeros(0))], [np.zeros(0)]
    for piece in pieces:
        if piece.t.size <= window:
            continue
        step = piece.t[1] - piece.t[0]
        x, v = (savgol_filter(column, window, 3) for column in (piece.x, piece.v))
        a = savgol_filter(piece.v, window, 3, deriv=1, delta=step)
        inner = slice(window // 2, -(window // 2))
        rest = a - piece.load + data.linear[0] * x + data.linear[1] * v
        target.append(rest[inner])
        rows.append(columns(x / data.sizes[0], v / data.sizes[1])[inner])
    return Rows(np.concatenate(rows), np.concatenate(target))


def joined(rows: Sequence[Rows]) -> Rows:
    """Rows of several records, each divided by the rms of its target."""
    scale = [max(float(np.sqrt(np.mean(own.target**2))), 1e-300) if own.target.size else 1.0 for own in rows]
    return Rows(
        np.concatenate([own.columns / s for own, s in zip(rows, scale, strict=True)]),
        np.concatenate([own.target / s for own, s in zip(rows, scale, strict=True)]),
    )


def stlsq(rows: Rows, threshold: float) -> np.ndarray:
    """Coefficients (k,) by sequentially thresholded least squares on columns of unit norm (Brunton et al. 2016)."""
    scale = np.linalg.norm(rows.columns, axis=0)
    scale[scale == 0.0] = 1.0
    columns, kept = rows.columns / scale, np.ones(scale.size, dtype=bool)
    found = np.zeros(scale.size)
    for _ in range(STLSQ_STEPS):
        found[:] = 0.0
        if not kept.any():
            break
        found[kept] = np.linalg.lstsq(columns[:, kept], rows.target, rcond=1e-10)[0]
        still = np.abs(found) >= threshold * np.linalg.norm(rows.target)
        if (still == kept).all():
            break
        kept = still
    return found / scale


def forward(rows: Rows, count: int) -> np.ndarray:
    """Coefficients (k,) of so many terms by orthogonal least squares, forwards (Billings 2013, section 3.2)."""
    columns = rows.columns / np.maximum(np.linalg.norm(rows.columns, axis=0), 1e-300)
    left, basis, chosen = rows.target, np.zeros((rows.target.size, 0)), []
    for _ in range(count):
        rest = columns - basis @ (basis.T @ columns)
        size = np.linalg.norm(rest, axis=0)
        gain = np.where(size > 1e-6, np.abs(left @ rest) / np.maximum(size, 1e-300), 0.0)
        chosen.append(int(gain.argmax()))
        basis = np.column_stack([basis, rest[:, chosen[-1]] / size[chosen[-1]]])
        left = rows.target - basis @ (basis.T @ rows.target)
    found = np.zeros(columns.shape[1])
    found[chosen] = np.linalg.lstsq(rows.columns[:, chosen], rows.target, rcond=1e-12)[0]
    return found


def ensemble_of_pysindy(rows: Rows, threshold: float) -> np.ndarray:
    """Coefficients (k,): medians of pysindy's STLSQ over bootstrapped rows, on columns of unit norm."""
    import pysindy as ps

    np.random.seed(0)  # noqa: NPY002 - pysindy draws from the global generator
    scale = np.linalg.norm(rows.columns, axis=0)
    scale[scale == 0.0] = 1.0
    level = np.linalg.norm(rows.target)
    inner = ps.STLSQ(threshold=threshold, alpha=1e-8, max_iter=STLSQ_STEPS)
    search = ps.EnsembleOptimizer(inner, bagging=True, n_models=MODELS)
    search.fit(rows.columns / scale, rows.target[:, None] / level)
    return np.ravel(search.coef_) * level / scale


class Trial(NamedTuple):
    """Rows of each record by one library in one way, and those by which its predictions are judged."""

    columns: Columns
    rows: list[Rows]
    judges: list[Rows]


Solver = Callable[[Rows], np.ndarray]


def solvers(thresholded: Callable[..., np.ndarray]) -> dict[str, Solver]:
    """Sparse regressions by name: thresholded ones, and forward ones of few terms."""
    found: dict[str, Solver] = {f"threshold {t:.2g}": partial(thresholded, threshold=float(t)) for t in THRESHOLDS}
    return found | {f"forward {count}": partial(forward, count=count) for count in COUNTS}


def regressed(trials: dict[str, Trial], sizes: tuple[float, float], solve: dict[str, Solver]) -> tuple[Force, str]:
    """Coefficients of the trial and the regression that predict left-out records best, in the weak form.

    Of those within a standard error of the best, the one of fewest terms (Breiman et al. 1984, section 3.4.3).
    """
    tried = []
    for name, trial in trials.items():
        for regression, solver in solve.items():
            left = []
            for k, judge in enumerate(trial.judges):
                found = solver(joined([own for j, own in enumerate(trial.rows) if j != k]))
                left.append(np.mean((judge.target - judge.columns @ found) ** 2) / np.mean(judge.target**2))
            tried.append((np.array(left), name, regression))
    best = min(tried, key=lambda own: own[0].mean())[0]
    near = [own for own in tried if (own[0] - best).mean() <= (own[0] - best).std(ddof=1) / np.sqrt(best.size)]
    models = [(solve[how](joined(trials[name].rows)), left.mean(), name, how) for left, name, how in near]
    found, _, name, how = min(models, key=lambda own: (np.count_nonzero(own[0]), own[1]))
    columns, said = trials[name].columns, f"{np.count_nonzero(found)} terms, {name}, {how}"
    return lambda x, v: columns(x / sizes[0], v / sizes[1]) @ found, said


def by_pysindy(data: Data, kind: str, told: bool, cut: bool = True) -> tuple[Force, str]:
    """Weak form and ensemble of pysindy."""
    records, trials = data.records if cut else [[piece] for piece in data.whole], {}
    for name, columns in libraries(kind, told).items():
        rng = np.random.default_rng(0)
        judges = [weak_rows(own, data, columns, JUDGED, rng) for own in data.records]
        for half in HALVES:
            rows = [weak_rows_of_pysindy(own, data, columns, half, rng) for own in records]
            if all(own.target.size for own in rows):
                trials[f"{name}, half width {half} s"] = Trial(columns, rows, judges)
    return regressed(trials, data.sizes, solvers(ensemble_of_pysindy))


def by_smoothing(data: Data, kind: str, told: bool) -> tuple[Force, str]:
    """Sparse regression on smoothed derivatives."""
    trials = {}
    for name, columns in libraries(kind, told).items():
        rng = np.random.default_rng(0)
        judges = [weak_rows(own, data, columns, JUDGED, rng) for own in data.records]
        for window in WINDOWS:
            rows = [smoothed_rows(own, data, columns, window) for own in data.records]
            if not all(own.target.size for own in rows):
                continue
            trials[f"{name}, window {window}"] = Trial(columns, rows, judges)
    return regressed(trials, data.sizes, solvers(stlsq))


# --- the comparison --------------------------------------------------------------------------------------------------


def methods() -> dict[str, Callable[[Data, str], tuple[Force, str]]]:
    """Peers by name: of the data and the law, for their library."""
    found: dict[str, Callable[[Data, str], tuple[Force, str]]] = {}
    if find_spec("pysindy"):
        found |= {
            "pysindy, law in its library": partial(by_pysindy, told=True),
            "pysindy, law not in it": partial(by_pysindy, told=False),
            "pysindy, in it, through impacts": partial(by_pysindy, told=True, cut=False),
        }
    return found | {
        "smoothed, law in its library": partial(by_smoothing, told=True),
        "smoothed, law not in it": partial(by_smoothing, told=False),
        "latent force": lambda data, kind: by_latent_force(data),
    }


def compared(seed: int, search: Callable[[Written, Hidden, np.ndarray, np.ndarray], tuple[float | None, str]]) -> None:
    """Play all methods on all laws of both sizes, and print a line each.

    search : calib's: the relative error over states (n,), and what it says
    """
    print(f"{'method':36s}{'law':10s}{'size':>6s}{'error':>8s}{'CPU s':>8s}")
    for size in SIZES:
        for kind in HIDDEN:
            _compared(seed, hidden("oscillator", kind, size, stop=True), search)
    if not find_spec("pysindy"):
        print("pysindy is not installed and was left out: pip install pysindy")


def _compared(seed: int, law: Hidden, search: Callable) -> None:
    """Play all methods on one law."""
    setup = system("oscillator", stop=True)
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        at = written(setup, law, NOISE, seed, Path(place))
        data = data_of(at, setup, (law.length, law.speed))
        x, v = np.concatenate([flight.states for name, flight in at.flights.items() if name != "unseen"]).T
        true = law.at(x, v)
        for name, method in methods().items():
            begin = time.process_time()
            force, said = method(data, law.kind)
            share = float(np.sqrt(np.mean((force(x, v) - true) ** 2) / np.mean(true**2)))
            _tell(name, law, share, begin, said)
        begin = time.process_time()
        error, said = search(at, law, x, v)
        _tell("calib discover", law, error, begin, said)


def _tell(name: str, law: Hidden, error: float | None, begin: float, said: str) -> None:
    own, seconds = "none" if error is None else f"{error:.1%}", time.process_time() - begin
    print(f"{name:36s}{law.kind:10s}{law.size:6g}{own:>8s}{seconds:8.1f}  {said}", flush=True)
