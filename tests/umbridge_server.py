"""A UM-Bridge server with an oscillator under a harmonic force: ``python umbridge_server.py PORT [EVALUATIONS]``.

After so many evaluations it dies.
"""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import contextmanager

import numpy as np
import umbridge
from child_environment import environment

HARMLESS, RAISES, NOT_A_NUMBER, SLEEPS, DIES, SHORT = range(6)  # faults, the last number of the first input vector


def motion(stiffness, damping, frequency, amplitude, time):
    """Stationary displacement and velocity (n,) of a mass of 1 kg; N/m, N s/m, Hz, N, s."""
    omega = 2.0 * np.pi * frequency
    x = amplitude / (stiffness - omega**2 + 1j * omega * damping) * np.exp(1j * omega * np.asarray(time))
    return x.real, (1j * omega * x).real


class Forced(umbridge.Model):
    """Input: stiffness [kN/m], damping [N s/m], fault; frequency, amplitude. Output: displacement, velocity."""

    def __init__(self, evaluations=None):
        super().__init__("forced")
        self.left = evaluations

    def get_input_sizes(self, config):
        return [3, 2]

    def get_output_sizes(self, config):
        return [config["periods"] * config["samples"]] * 2

    def supports_evaluate(self):
        return True

    def __call__(self, inputs, config):
        (stiffness, damping, fault), (frequency, amplitude) = inputs
        if fault == DIES or self.left == 0:
            os._exit(1)
        self.left = None if self.left is None else self.left - 1
        if fault == RAISES:
            raise ValueError("the mesh is tangled")
        if fault == SLEEPS:
            time.sleep(1.0)
        count = config["periods"] * config["samples"]
        x, v = motion(
            1e3 * stiffness, damping, frequency, amplitude, np.arange(count) / (frequency * config["samples"])
        )
        if fault == NOT_A_NUMBER:
            x[3] = np.nan
        return [x.tolist()[: count - (fault == SHORT)], v.tolist()]


class Sampled(umbridge.Model):
    """Input: stiffness, damping; times; force at them, a cosine of 9 Hz. Output: displacement [mm], then velocity."""

    def get_input_sizes(self, config):
        return [2, 1, 1]

    def get_output_sizes(self, config):
        return [2]

    def supports_evaluate(self):
        return True

    def __call__(self, inputs, config):
        (stiffness, damping), times, force = inputs
        x, v = motion(stiffness, damping, 9.0, max(force), times)
        return [[*(1e3 * x).tolist(), *v.tolist()]]


class Stepping(umbridge.Model):
    """Input: stiffness, damping; 9 Hz and 2 N are built in. Output: times [ms], displacement, 60 steps of 1/540 s."""

    def get_input_sizes(self, config):
        return [2]

    def get_output_sizes(self, config):
        return [60, 60]

    def supports_evaluate(self):
        return True

    def __call__(self, inputs, config):
        times = np.arange(60) / 540.0
        return [(1e3 * times).tolist(), motion(*inputs[0], 9.0, 2.0, times)[0].tolist()]


class Mute(umbridge.Model):
    """A model that cannot be evaluated."""

    def get_input_sizes(self, config):
        return [1]

    def get_output_sizes(self, config):
        return [1]


@contextmanager
def serving(port=None, evaluations=None):
    """Yield (URL, process) of a server in a process of its own that answers."""
    port = free_port() if port is None else port
    with started(port, evaluations) as process:
        try:
            await_answer(port)
            yield f"http://127.0.0.1:{port}", process
        finally:
            process.kill()


def started(port, evaluations=None):
    """Start a server."""
    command = [sys.executable, __file__, str(port), *([] if evaluations is None else [str(evaluations)])]
    return subprocess.Popen(command, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def await_answer(port, seconds=60.0):
    """Wait until a server answers."""
    until = time.monotonic() + seconds
    while True:
        try:
            return urllib.request.urlopen(f"http://127.0.0.1:{port}/Info", timeout=5.0).close()
        except OSError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def free_port():
    """Return a port that nobody listens to."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


if __name__ == "__main__":
    port, *evaluations = [int(text) for text in sys.argv[1:]]
    models = [Forced(*evaluations), Sampled("sampled"), Stepping("stepping"), Mute("mute")]
    umbridge.serve_models(models, port, error_checks=False)
