"""Programs as C99 that is also C++17: readable, without state, and the same bytes every time."""
