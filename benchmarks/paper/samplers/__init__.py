"""Which sampler, in how many steps, and which mode of guidance succeed as often as ten steps of Euler's."""
