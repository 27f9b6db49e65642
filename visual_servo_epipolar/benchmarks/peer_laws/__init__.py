"""Peer laws: other visual servos as steps of the closed loop, with our perception."""
