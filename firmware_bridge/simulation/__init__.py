"""The simulated team behind `--bridge sim`."""
