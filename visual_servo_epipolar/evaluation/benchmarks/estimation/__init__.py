"""Estimation benchmark: our estimators and peers on synthetic pairs of views."""
