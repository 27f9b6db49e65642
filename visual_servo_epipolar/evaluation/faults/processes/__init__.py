"""Faults of real processes: killed, hung up, stopped and continued, judged by ground truth."""
