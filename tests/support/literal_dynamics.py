"""The plant's arithmetic written out, for floats and tensors alike."""


def drive(position, speed, action, dynamics, steps):
    """Integrate the dynamics literally: drag once a step, then semi-implicit substeps."""
    h = dynamics.dt_s / dynamics.substeps
    for _ in range(steps):
        speed = (1 - dynamics.drag) * speed
        for _ in range(dynamics.substeps):
            speed = speed + action / dynamics.mass_kg * h
            position = position + speed * h
    return position, speed
