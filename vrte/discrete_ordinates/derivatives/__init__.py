"""Derivatives of multiply and singly scattered light: the algebra of slabs and interfaces, differentiated."""
