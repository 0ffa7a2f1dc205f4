"""edge-report: what logs tell, on one page.

`digest` gathers one run's records into arrays, `team` lays several robots' runs on one time axis,
`sections` draws them, `command` is edge-report.
"""
