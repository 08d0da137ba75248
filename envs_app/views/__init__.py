"""The HTTP API: a view reads the request, calls one function and writes its reply."""
