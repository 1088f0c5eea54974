"""Requests and their options, checked before any work."""
