"""Networks compiled for chips with cores at places of a mesh, and for the open core."""
