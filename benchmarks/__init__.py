"""Speed, memory, load and learning, each against a baseline taken in the same run (DESIGN.md section 6)."""
