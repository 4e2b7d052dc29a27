// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes the engine makes for itself: images in memory at both ends, constants, copies. They are
/// not registered; no graph file names them.
#pragma once

#include "rayloom/core/node.h"
#include "rayloom/engine/request.h"

namespace rayloom
{

/// Hands out an image in memory. Output port "image".
class MemorySource final : public Node
{
public:
    explicit MemorySource(std::shared_ptr<const MemoryImage> image) : m_image(std::move(image)) {}
    void plan(PlanContext& context) override;
    void compute(const TileContext& context) const override;
    std::string content_key(bool thorough) const override;
    ConstImageView pixels() const { return std::as_const(*m_image).pixels.view(); }

private:
    std::shared_ptr<const MemoryImage> m_image;
};

/// Gathers the rows of input "image" in memory.
class MemorySink final : public Node
{
public:
    void plan(PlanContext& context) override;
    void compute(const TileContext& context) const override;
    MemoryImage take() { return std::move(*m_image); }

private:
    std::shared_ptr<MemoryImage> m_image;
};

/// Fills output "image" with one value.
class ConstantNode final : public Node
{
public:
    ConstantNode(ImageDesc desc, float value) : m_desc(std::move(desc)), m_value(value) {}
    void plan(PlanContext& context) override { context.output("image", m_desc); }
    void compute(const TileContext& context) const override;

private:
    ImageDesc m_desc;
    float m_value;
};

/// Copies input "image"; stands in for a pass-through when shortcuts are switched off.
class CopyNode final : public Node
{
public:
    void plan(PlanContext& context) override { context.output("image", context.input("image")); }
    void compute(const TileContext& context) const override
    {
        copy_pixels(context.input("image"), context.output("image"));
    }
};

} // namespace rayloom
