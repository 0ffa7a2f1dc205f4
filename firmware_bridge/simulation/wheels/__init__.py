"""The plant ``mujoco``: robots on wheels that slip, in MuJoCo."""
