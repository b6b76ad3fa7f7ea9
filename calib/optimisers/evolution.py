"""One run of CMA-ES, small and without a library, for the population that multistart keeps beside its searches."""

import numpy as np

MIN_POPULATION_WIDTH = 1e-4  # of the window: standard deviation along the longest axis that ends a run  [1]
MAX_POPULATION_ASPECT_RATIO = 1e6  # of the longest to the shortest axis of the covariance  [1]


class Evolution:
    """Covariance matrix adaptation; equation numbers are those of Hansen (2016), arXiv:1604.00772.

    Points outside the cube are moved onto it before they are evaluated, and learnt from where they then lie.
    """

    def __init__(self, centre: np.ndarray, sigma: float, size: int, rng: np.random.Generator):
        dim = centre.size
        self.centre, self.sigma, self.size, self.rng, self.generation = centre, sigma, size, rng, 0
        raw = np.log((size + 1) / 2) - np.log(np.arange(1, size // 2 + 1))  # eq. (49)
        self.weights = raw / raw.sum()  # eq. (53)
        self.effective = mu = 1 / (self.weights**2).sum()  # eq. (8)
        self.c_sigma = (mu + 2) / (dim + mu + 5)  # eq. (55)
        self.damping = 1 + 2 * max(0, np.sqrt((mu - 1) / (dim + 1)) - 1) + self.c_sigma  # eq. (55)
        self.c_c = (4 + mu / dim) / (dim + 4 + 2 * mu / dim)  # eq. (56)
        self.c_1 = 2 / ((dim + 1.3) ** 2 + mu)  # eq. (57)
        self.c_mu = min(1 - self.c_1, 2 * (mu - 2 + 1 / mu) / ((dim + 2) ** 2 + mu))  # eq. (58)
        self.expected = np.sqrt(dim) * (1 - 1 / (4 * dim) + 1 / (21 * dim**2))  # E|N(0, I)|
        self.path_sigma, self.path_c, self.covariance = np.zeros(dim), np.zeros(dim), np.eye(dim)
        self.axes, self.lengths = np.eye(dim), np.ones(dim)

    def sample(self) -> np.ndarray:
        """Points (size, dim) of the next generation."""
        z = self.rng.standard_normal((self.size, self.centre.size))
        return np.clip(self.centre + self.sigma * (z * self.lengths) @ self.axes.T, 0, 1)  # eq. (38)-(40)

    def learn(self, points: np.ndarray, costs: np.ndarray) -> None:
        """Update by a generation's points (size, dim) and costs (size,); not by one that failed altogether."""
        self.generation += 1
        if not np.isfinite(costs).any():
            return
        dim = self.centre.size
        order = np.argsort(costs, kind="stable")[: self.weights.size]
        steps = (points[order] - self.centre) / self.sigma
        mean = self.weights @ steps  # eq. (41)
        self.centre = np.clip(self.centre + self.sigma * mean, 0, 1)  # eq. (42)
        whitened = self.axes @ ((self.axes.T @ mean) / self.lengths)
        self.path_sigma += (
            np.sqrt(self.c_sigma * (2 - self.c_sigma) * self.effective) * whitened - self.c_sigma * self.path_sigma
        )  # eq. (43)
        length = np.linalg.norm(self.path_sigma)
        self.sigma *= np.exp(min(1.0, self.c_sigma / self.damping * (length / self.expected - 1)))  # eq. (44)
        settled = np.sqrt(1 - (1 - self.c_sigma) ** (2 * self.generation))
        rising = length / settled < (1.4 + 2 / (dim + 1)) * self.expected
        self.path_c += (
            rising * np.sqrt(self.c_c * (2 - self.c_c) * self.effective) * mean - self.c_c * self.path_c
        )  # eq. (45)
        lost = (1 - rising) * self.c_c * (2 - self.c_c)
        self.covariance = (
            (1 - self.c_1 - self.c_mu + self.c_1 * lost) * self.covariance
            + self.c_1 * np.outer(self.path_c, self.path_c)
            + self.c_mu * (steps.T * self.weights) @ steps
        )  # eq. (47)
        squares, self.axes = np.linalg.eigh(self.covariance)
        self.lengths = np.sqrt(np.maximum(squares, 1e-20 * squares.max()))

    def over(self) -> bool:
        """Whether the generation has become too small, or too flat, to find anything new."""
        longest, shortest = float(self.lengths.max()), float(self.lengths.min())
        return self.sigma * longest < MIN_POPULATION_WIDTH or longest > MAX_POPULATION_ASPECT_RATIO * shortest
