"""The exact method, one stage a file, named after the sections of Collin, Pattanaik and Bouatouch."""
