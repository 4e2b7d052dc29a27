// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include "rayloom/core/error.h"

#include <gtest/gtest.h>

#include <stdexcept>

using namespace rayloom;

namespace
{

NodeInfo described()
{
    NodeInfo info;
    info.name = "test.described";
    return info;
}

NodeInfo undescribed() { throw std::runtime_error("no description today"); }

} // namespace

// Plug-ins, where nothing may be thrown, are the test installed.throwing_plugin.
TEST(Registry, WhatADescriptionThrowsComesOut)
{
    Registry registry;
    EXPECT_THROW(registry.add(&undescribed), std::runtime_error);
    EXPECT_TRUE(registry.all().empty());
}

TEST(Registry, ANameIsTakenOnce)
{
    Registry registry;
    registry.add(&described);
    EXPECT_EQ(registry.names(), std::vector<std::string>{"test.described"});
    EXPECT_THROW(registry.add(&described), Error);
    EXPECT_THROW(registry.add(described()), Error);
}
