"""Questions asked of the surrogates: relevant factors, SNR, effective scope, audit."""
