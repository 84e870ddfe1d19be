"""Direct lighting and paths by multiple importance sampling."""
