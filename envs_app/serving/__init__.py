"""`manage.py serve`: one process that starts, watches and ends all others of the embedded set-up."""
