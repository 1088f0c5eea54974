"""A plan carried out and added up."""
