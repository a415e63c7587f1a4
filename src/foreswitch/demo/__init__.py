"""What can it do? The hot-gas example from a pulse test to a certificate, in one report (`hot_gas`)."""
