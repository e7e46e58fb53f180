"""Independent solutions: closed forms and collocation, for tests and for the book's checks.

Nothing here uses the library's structures, laws or solvers; the methods differ on purpose from
those of the rest of the library, so that agreement means something.
"""
