"""Ensembles on graphics cards: one trajectory a thread.

In: a stepper and many starts.
Out: trajectories, computed on a graphics card.
Open first: ``ensemble.DeviceEnsemble``.

    cuda_text     the control profile of a stepper and its kernels as one CUDA text
    device        what an ensemble needs of a device: memory, compilation, launches
    cuda_device   a card, by cuda-core and NVRTC
    host_device   the same text compiled as C and run by a loop: for tests
    trajectories  launches, slice by slice, and stored states
    ensemble      which device, what it refuses, trajectories that stay on a card
"""
