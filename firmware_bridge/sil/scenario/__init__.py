"""What a run in the loop is to be: flags, files, faults and limits."""
