"""The tables of a paper, measured anew: `python -m tools.paper_tables genmm`.

Measures Tables 1 to 4 and Figure 9 of the GenMM paper (sections 4.1 to 4.4) on the clips at hand and writes a page of
Markdown, a CSV file a table, and plots. Generators are named, so that any that is registered can have its rows. Every
cell is kept under the folder's `.cache` until code, settings or clips change: a run that was ended goes on.
"""
