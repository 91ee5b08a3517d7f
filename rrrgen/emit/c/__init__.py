"""The C backend: prints programs as readable, stateless, reproducible C99 that is valid C++17 too."""
