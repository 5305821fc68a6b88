"""What is identified: parameters, laws, geometry, and the problem they pose."""
