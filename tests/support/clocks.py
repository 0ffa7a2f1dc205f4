"""Clocks that a test moves."""


class Clock:
    """Time that passes by sleeping, and by ``now`` being moved."""

    def __init__(self, oversleep=0.0):
        self.now, self.oversleep = 100.0, oversleep

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        assert seconds >= 0.0
        self.now += seconds + self.oversleep
