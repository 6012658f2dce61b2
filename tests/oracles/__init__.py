"""What several tests trust: formulas by hand, quadratures, statistical tests, other programs, made results."""
