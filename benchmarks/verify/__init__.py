"""QP back ends held against independent solvers on many thousands of programs."""
