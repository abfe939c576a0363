"""Views in space that one can turn: Plotly figures made of plain traces."""
