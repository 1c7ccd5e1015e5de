"""Reproduction of Khalifa & Palli: tables and figures side by side, and verdicts on the claims."""
