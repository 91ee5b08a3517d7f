"""The C backend: programs as C99 that is also C++17, readable, stateless and reproducible."""
