"""The far field and its gradient in torch, for optimisers."""
