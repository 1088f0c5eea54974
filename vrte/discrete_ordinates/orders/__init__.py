"""One Fourier order solved: the stages of the GPU paper, and what needs no eigenproblem."""
