"""Write gru_fixture.npz: a GRUCell of PyTorch run for six steps (`python make_gru_fixture.py`, torch 2.13).

The tests do without torch: the numbers are stored. Weights are stacked reset, update, new, as PyTorch has
them (`weight_ih` `[3 k, d]`, `weight_hh` `[3 k, k]`).
"""

from pathlib import Path

import numpy as np
import torch

INPUT, STATE, BATCH, STEPS = 5, 4, 3, 6


def main() -> None:
    torch.manual_seed(0)
    cell = torch.nn.GRUCell(INPUT, STATE)
    for parameter in cell.parameters():  # wider than the default, so that the gates open and close
        torch.nn.init.normal_(parameter, std=0.8)
    x, h = torch.randn(STEPS, BATCH, INPUT), torch.randn(BATCH, STATE)
    states = [h]
    with torch.no_grad():
        for step in x:
            states.append(cell(step, states[-1]))
    arrays = {name: parameter.detach().numpy() for name, parameter in cell.named_parameters()}
    np.savez(
        Path(__file__).with_name("gru_fixture.npz"), x=x.numpy(), states=torch.stack(states).numpy(), **arrays
    )


if __name__ == "__main__":
    main()
