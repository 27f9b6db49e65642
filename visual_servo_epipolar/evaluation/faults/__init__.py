"""Fault campaign: closed loops on images with faults in them, judged by ground truth alone."""
