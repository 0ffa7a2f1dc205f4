"""What a team tells whoever watches it, and the terminal view that shows it.

`status` is the record, `sender` the robot's side; `team` receives, `view` and `plain` show, `command` is
edge-watch. Data flows one way: a robot never reads what comes back from the watcher's address.
"""
