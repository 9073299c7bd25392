// Constants that all strokes of a frame share. Declares no bindings.

struct Canvas {
    uvec2 size;       // pixels of the strip
    uvec2 tiles;      // across and down
    vec2 middle;      // pixels of the whole picture
    vec2 corner;      // of the strip in the whole picture, where strokes are computed
    float focal;      // pixels; orthographic: pixels per metre
    vec3 right;       // world to view, down as rows go
    vec3 down;
    vec3 forward;
    vec3 axis_x;      // axes of the cloud, for tangents
    vec3 axis_y;
    vec3 axis_z;
    float scale;      // half a stroke's side, radii
    float ground;     // reach of ground from the middle, as a share of a side
    float nearer;     // reduction for near ground: share of what exceeds a pixel
    float nearer_px;  // and its largest value [px]
    float least_px;   // smallest half side on the screen
    float largest_px;
    float lengthen;   // lengthening on elongated clusters
    float detail;     // opacity of the second layer of small clusters
    vec2 reach;       // reach of the brush from the middle, as a share of a side
    uint word;        // first of the point's two words, after the position planes
    uint kind;        // word of its kind, if known
    uint tangents;
    float hides;      // coverage that hides what is behind
    float lo;         // attribute words at the ends of the ramp
    float ramp;       // 255 / (hi - lo)
};
