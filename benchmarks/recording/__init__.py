"""What a run's log and its watcher cost the loop."""
