// One colour.
#version 460

layout(location = 0) out vec4 color;

void main() {
    color = vec4(0.9, 0.5, 0.1, 1.0);
}
