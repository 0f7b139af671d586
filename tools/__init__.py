"""Programs beside the library: benchmarks, tables, files made once. Run them as `python -m tools.NAME`."""
