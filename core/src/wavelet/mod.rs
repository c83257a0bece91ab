//! Wavelets (appendix A).
