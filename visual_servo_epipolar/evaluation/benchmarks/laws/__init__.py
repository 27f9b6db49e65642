"""Benchmark of control laws: peers as steps of the closed loop, with our perception."""
