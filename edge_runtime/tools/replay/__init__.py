"""edge-replay: every decision of a log again, or under other objectives or another policy."""
