"""Steps in other libraries."""
