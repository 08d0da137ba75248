"""Bored in the city with simulated visitors: what its agent learns, beside bandits from a library (issue 5)."""
