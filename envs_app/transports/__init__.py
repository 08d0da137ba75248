"""Transports: what carries steps from web processes to executions. Kept free of Django for the executions' side."""
