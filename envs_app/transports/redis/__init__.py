"""Steps through Redis: web processes and executions on any number of machines. docs/adr/0009 says why it is as it is."""
