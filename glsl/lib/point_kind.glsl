// Opacity of a point by its kind: class (8 bits, lowest), return number (4 bits), from bit 16 on
// the number of the station (src/select/opacity.rs). The includer has `opacities`: factors of 256
// classes, 16 return numbers, and every station.

#ifndef KIND
#define KIND

float opacity_of(uint kind) {
    float of_class = opacities.factor[kind & 255u];
    float of_return = opacities.factor[256u + (kind >> 8 & 15u)];
    float of_station = opacities.factor[272u + (kind >> 16)];
    return of_class * of_return * of_station;
}

#endif
