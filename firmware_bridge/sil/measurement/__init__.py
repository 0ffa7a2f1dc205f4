"""What a run leaves behind: samples, costs, wake-ups, logs, and the records of its report."""
