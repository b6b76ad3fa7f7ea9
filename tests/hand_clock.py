"""A clock that is set by hand."""


class HandClock:
    """A clock that goes on when it is told to."""

    now = 0.0  # s

    def __call__(self):
        return self.now
