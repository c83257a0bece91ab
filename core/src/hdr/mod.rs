//! High dynamic range photographs: camera response, and brackets merged to radiance (2.2.1).
