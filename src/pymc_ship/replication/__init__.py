"""The paper's study from end to end, and its page.

- `study`: the study in the paper's order.
- `estimates`: coefficients and intervals of every method in one form.
- `scores`: errors, coverages and their standard errors.
- `denoisers`: methods of denoising, and draws of the denoised record carried into the regression.
- `measurements`: discretisation, methods, published errors.
- `prior_ships`: the ships that the study's own priors hold.
- `findings`: what the study found, in sentences.
- `bound_chapter`: the published errors beside the bound.
- `tables`: tables of the page and as CSV.
- `figures`: figures of the study.
- `page`: the page of the study.
"""
