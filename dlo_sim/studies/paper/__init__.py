"""Khalifa & Palli reproduced: their tables and figures beside ours, their claims judged."""
