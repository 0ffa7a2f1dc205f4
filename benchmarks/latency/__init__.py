"""How long one control tick takes: ``python -m benchmarks latency``."""
