// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes the engine makes for itself: images in memory at both ends, constants, copies. They are
/// not registered; no graph file names them.
#pragma once

#include "rayloom/core/deep_node.h"
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

/// Hands out a deep image in memory. Output port "deep".
class MemoryDeepSource final : public DeepSource
{
public:
    explicit MemoryDeepSource(std::shared_ptr<const MemoryDeep> deep) : m_deep(std::move(deep)) {}
    void plan(PlanContext& context) override;
    DeepRow read_deep_row(int y) const override
    {
        return *m_deep->rows[static_cast<std::size_t>(y - m_deep->desc.data.y0)];
    }
    std::size_t row_samples() const override { return m_row_samples; }
    std::string content_key(bool thorough) const override;

private:
    std::shared_ptr<const MemoryDeep> m_deep;
    std::size_t m_row_samples = 0;
};

/// Gathers the rows of input "deep" in memory.
class MemoryDeepSink final : public Node
{
public:
    void plan(PlanContext& context) override;
    void compute(const TileContext& context) const override;
    MemoryDeep take() { return std::move(*m_deep); }

private:
    std::shared_ptr<MemoryDeep> m_deep;
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

/// The same for a deep image.
class DeepCopyNode final : public DeepNode
{
public:
    void plan(PlanContext& context) override { context.output("image", context.input("image")); }
    DeepRow deep_row(const TileContext& context, int y) const override
    {
        return context.deep("image").row(y);
    }
};

} // namespace rayloom
