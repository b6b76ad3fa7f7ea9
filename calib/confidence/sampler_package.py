"""The packages of the extra `calib[confidence]`, imported where a posterior is sampled: nautilus and ArviZ."""

import importlib
import warnings
from types import ModuleType
from typing import Any

import numpy as np

from calib.errors import CalibError

FLAT_TOP = 0.05  # range of the log-likelihood of live points within which shells inside shells tell nothing  [1]
TOP_QUANTILES = 0.05, 0.95  # of the live points, between which that range is taken: points of another mode are outside


def nested_sampler() -> type[Any]:
    """Return nautilus' sampler, whose exploration ends also where the live points are equally likely.

    It ends otherwise where they hold a small share of the evidence. A few of them may belong to a narrow mode beside a
    wide one: they lie in an early shell and stand for a large share, which shells within shells of the wide mode never
    lessen, but points in their own shell do, and these are drawn when exploration has ended.

    Raises
    ------
    CalibError : nautilus is not installed
    """
    package = nautilus()

    class NestedSampler(package.Sampler):  # type: ignore[name-defined]
        @property
        def f_live(self) -> float | None:
            """Share of the evidence in the live points; 0 where they are equally likely, None after exploration."""
            share: float | None = super().f_live
            if share is None or self.shell_n.sum() < self.n_live:
                return share
            low, high = np.quantile(np.sort(np.concatenate(self.log_l))[-self.n_live :], TOP_QUANTILES)
            return 0.0 if high - low < FLAT_TOP else share

    return NestedSampler


def nautilus() -> ModuleType:
    """Return the package nautilus.

    Raises
    ------
    CalibError : it is not installed
    """
    return _imported("nautilus", "nautilus-sampler")


def arviz() -> ModuleType:
    """Return the package arviz.

    Raises
    ------
    CalibError : it is not installed
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "\\s*ArviZ is undergoing a major refactor", FutureWarning)
        return _imported("arviz", "arviz")


def _imported(name: str, package: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise CalibError(
            f"--posterior needs the package {package}, which does not import ({error}); "
            'install it: pip install "calib[confidence]"'
        ) from error
