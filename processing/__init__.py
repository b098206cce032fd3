"""Separation of light from arrays alone: patterns, estimators, decompositions, measures."""
