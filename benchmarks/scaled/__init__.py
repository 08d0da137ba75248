"""Rows about the scaled-out set-up, beside the embedded one in the same run."""
