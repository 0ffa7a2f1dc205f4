"""The link to firmware: bridges, the simulated plant, the guard."""
