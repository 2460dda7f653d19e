"""Whole jobs, one package each and named as its command: what needs several rooms put to work together."""
