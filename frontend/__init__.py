"""Web pages for people: Bored in the city."""
