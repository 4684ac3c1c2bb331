"""Figures for paper and screen in one house style; every function returns a matplotlib figure.

Each module draws one figure: `views` (the vehicle from three sides), `comparison` (measured against
simulated), `search_history` (convergence), `characteristic_curve` (command to thrust); `style` holds what
they share and saves them. matplotlib is loaded when the first figure is drawn, without a display.
"""
