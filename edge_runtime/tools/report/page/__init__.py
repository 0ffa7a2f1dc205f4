"""One self-contained HTML page of figures and tables: edge-report's, edge-sil's and the benchmarks'.

`page` says what a page holds and writes it, `chart` and `arena` draw (matplotlib, an extra), `theme` makes
drawings follow the page's colours and type.
"""
