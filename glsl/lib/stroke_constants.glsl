// What all strokes of a frame share. Declares no bindings.

struct Canvas {
    uvec2 size;       // pixels, of the band
    uvec2 tiles;      // across and down
    vec2 middle;      // of the whole picture, pixels
    vec2 corner;      // of the band, in the whole picture: strokes lie in that, so that its parts round them alike
    float focal;      // pixels; orthographic: pixels per metre
    vec3 right;       // world to view, down as rows go
    vec3 down;
    vec3 forward;
    vec3 axis_x;      // of the cloud: what tangents of normals are found in
    vec3 axis_y;
    vec3 axis_z;
    float scale;      // half a stroke's side, radii
    float ground;     // how far from its middle a stroke may lie on its surface, whatever its brush; parts of a side
    float nearer;     // how much less far it does for certain: parts of what is more than a pixel
    float nearer_px;  // and pixels, at most
    float least_px;   // of half a side, on the screen
    float largest_px;
    float lengthen;   // how much of a cluster's length its strokes take on
    float detail;     // how opaque the second layer of small clusters is
    vec2 reach;       // where a brush ends, from its middle, parts of a side
    uint word;        // the first of the point's two, counted after the position planes
    uint kind;        // the one of its kind, where points bring it
    uint tangents;
    float hides;      // coverage that hides what is behind
    float lo;         // attribute words at the ends of the ramp
    float ramp;       // 255 / (hi - lo)
};
