"""The chapter of the report that presents a diagnosis."""
