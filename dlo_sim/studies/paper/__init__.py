"""Khalifa & Palli, reproduced and checked: their tables and figures beside ours, their claims judged."""
