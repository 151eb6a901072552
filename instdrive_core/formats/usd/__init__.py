"""OpenUSD's ParticleField3DGaussianSplat: .usd, .usda, .usdc and .usdz (extra `usd`)."""
