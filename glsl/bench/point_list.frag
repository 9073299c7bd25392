#version 460

layout(location = 0) flat in uint point;
layout(location = 0) out uint index;

void main() {
    index = point;
}
